// What kernels compute with: doubles, or floats in a program that is made with SINGLE. STALLED: a fixed point that moves
// by no more than this, relative to the largest element, moves by rounding alone; INDEPENDENT: of two steps, above it, the
// determinant of their scalar products over the product of their squares.
#ifdef SINGLE
#define real float
#define real2 float2
#define real4 float4
#define REAL_BYTES 4
#define STALLED 4e-7
#define INDEPENDENT 1e-4
#undef ENDLESS
#define ENDLESS 1e30
#else
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#define real double
#define real2 double2
#define real4 double4
#define REAL_BYTES 8
#define STALLED 4e-16
#define INDEPENDENT 1e-10
#endif

// Matrices are stored column by column; "ld" is the distance of two columns, a multiple of 8 doubles, so that a column
// starts where eight doubles may be loaded at once. A stack holds one matrix an item, `stride` doubles apart; `items`
// lists which of them a launch is for.
// vload4 and fma are calls on some devices: pointers to vectors and a * b + c are not.

#define AT(p, i) (((__global const real4*)(p))[i])
#define PUT(p, i) (((__global real4*)(p))[i])

typedef real4 loose4 __attribute__((aligned(REAL_BYTES)));     // four that begin at any of them

// What kernels take for a stack of matrices and of vectors; where its item begins.
#define STACK(x) __global real* x, long x##_first, int x##_ld, long x##_stride
#define OF_ITEM(x) (x + x##_first + item * x##_stride)

// Memory that nothing else of a kernel leads to: what is read, and what is written.
#define IN __global const real* restrict
#define INTS __global const int* restrict
#define OUT __global real* restrict
