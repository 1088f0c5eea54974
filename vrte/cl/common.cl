// What kernels compute with: doubles, or floats in a program that is made with SINGLE. STALLED: a fixed point that moves
// by no more than this, relative to the largest element, moves by rounding alone; INDEPENDENT: of two steps, above it, the
// determinant of their scalar products over the product of their squares; DOUBLED: how far Zo Ze of a semi-infinite slab is
// from 1 before the last doubling, which squares that.
#ifdef SINGLE
#define real float
#define real4 float4
#define REAL_BYTES 4
#define STALLED 4e-7
#define INDEPENDENT 1e-4
#undef SEMI_INFINITE
#define SEMI_INFINITE 1e30
#undef NO_LIGHT
#define NO_LIGHT 1e-30
#define DOUBLED 1e-4
#define mask int4
#else
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#define real double
#define real4 double4
#define REAL_BYTES 8
#define STALLED 4e-16
#define INDEPENDENT 1e-10
#define DOUBLED 1e-9
#define mask long4
#endif

// Names of core/kernels/*.h, which come behind this file: four numbers at once; memory that tables lie in.
#define lanes real4
#define STORED __global const
#define VRTE_SHARED
#define VRTE_LIST __constant const

// Matrices are stored column by column; "ld" is the distance of two columns, a multiple of 8 doubles, so that a column
// starts where eight doubles may be loaded at once. A stack holds one matrix an item, `stride` doubles apart.
// vload4 and fma are calls on some devices: pointers to vectors and a * b + c are not.

#define AT(p, i) (((__global const real4*)(p))[i])
#define PUT(p, i) (((__global real4*)(p))[i])

typedef real4 loose4 __attribute__((aligned(REAL_BYTES)));     // four that begin at any of them

// KERNEL: what it takes is declared in core/stages.toml, by these names. Its pieces of work are shared by `lanes` work-items
// each, a work-group: LANES on a GPU, one on a processor. "Pieces" above it says how many a launch has. SPREAD: a lane's part of what is numbered first ..
// last - 1, neighbours to neighbours; TOGETHER: each lane sees what the others wrote, and all lanes meet there. Such loops are
// short: as vectors they take PoCL twice as long to compile, and 1 to 3 % less time to run.
#define KERNEL(lanes, name) __attribute__((reqd_work_group_size(lanes, 1, 1))) __kernel void name(TAKES_##name)
#define LANE ((int)get_local_id(0))
#define SPREAD(i, first, last) _Pragma("clang loop vectorize(disable) interleave(disable)") \
    for (int i = (first) + LANE; i < (last); i += LANES)
#if LANES > 1
#define TOGETHER barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
#else
#define TOGETHER
#endif

// The next multiple of 8.
int next_strip(int rows)
{
    return (rows + 7) / 8 * 8;
}

// The larger one, or what is no number.
real larger(real a, real b)
{
    return b > a || b != b ? b : a;
}

// The sum of what all lanes of a piece have, or the largest, to all of them; shelf: room for one of each.
real of_lanes(bool adding, real mine, __local real* shelf)
{
    if (LANES == 1)
        return mine;
    shelf[LANE] = mine;
    for (int apart = LANES / 2; apart > 0; apart /= 2) {
        TOGETHER
        if (LANE < apart)
            shelf[LANE] = adding ? shelf[LANE] + shelf[LANE + apart] : larger(shelf[LANE], shelf[LANE + apart]);
    }
    TOGETHER
    const real found = shelf[0];
    TOGETHER
    return found;
}

// Where an item of a stack of matrices begins.
#define OF_ITEM(x) (x + x##_first + item * x##_stride)
