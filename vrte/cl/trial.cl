// What a driver has to compute before its device is taken.
__kernel void trial(__global double *x) { x[0] = 2.0 * x[0] + 1.0; }
