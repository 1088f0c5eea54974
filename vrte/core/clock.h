#ifdef _OPENMP
#include <omp.h>
static const int vrte_openmp = 1;
static double vrte_seconds(void) { return omp_get_wtime(); }
#else
#include <time.h>
static const int vrte_openmp = 0;
static double vrte_seconds(void) {
    struct timespec now;
    timespec_get(&now, TIME_UTC); /* C11: where a compiler has no OpenMP, it may have no clock_gettime either */
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}
#endif
