// What a driver has to compute before its device is taken.
#ifdef SINGLE
#define real float
#else
#define real double
#endif
__kernel void probe(__global real *x) { x[0] = 2.0 * x[0] + 1.0; }
