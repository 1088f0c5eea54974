/* Loops of whole columns, which a compiler turns into vectors of any width. With GNU C on x86-64 each is compiled a
   second time for AVX2 and FMA, and the processor says which one runs: NAME_best(wide) is that function, and `wide` 0
   leaves AVX2 unused. Elsewhere the two are alike. */
#pragma once
#include <stddef.h>
#if defined(__GNUC__)
#define VRTE_INLINE static inline __attribute__((always_inline))
#define VRTE_OWN __restrict__
#else
#define VRTE_INLINE static __inline
#define VRTE_OWN __restrict
#endif
#if defined(__GNUC__) && defined(__x86_64__)
#define VRTE_WIDE __attribute__((target("avx2,fma")))
static int vrte_is_wide(void) {
    __builtin_cpu_init();
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
}
#else
#define VRTE_WIDE
static int vrte_is_wide(void) { return 0; }
#endif
#define VRTE_TWICE(RESULT, NAME, PARAMETERS, CALL)                                      \
    typedef RESULT NAME##_form PARAMETERS;                                              \
    static RESULT NAME##_plain PARAMETERS { CALL; }                                     \
    VRTE_WIDE static RESULT NAME##_wide PARAMETERS { CALL; }                            \
    static NAME##_form* NAME##_best(int wide) {                                         \
        return wide && vrte_is_wide() ? NAME##_wide : NAME##_plain;                     \
    }
