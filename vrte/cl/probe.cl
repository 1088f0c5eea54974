// What a driver has to compute before its device is taken: a sum and a loop.
#ifdef SINGLE
#define real float
#else
#define real double
#endif
__kernel void probe(TAKES_probe)
{
    real sum = 0.0;
    for (int i = 0; i < turns; i++)
        sum += x[1];
    x[0] = 2.0 * x[0] + 1.0;
    x[1] = sum;
}
