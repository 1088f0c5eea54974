#include <time.h>
#ifdef _OPENMP
static const int vrte_openmp = 1;
#else
static const int vrte_openmp = 0;
#endif
static double vrte_seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}
