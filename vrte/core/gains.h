#pragma once
#include <math.h>

#include "constants.h"
#include "wide.h"

typedef struct {
    /* What arrives at a depth of a layer from its far face, by rows: the Stokes parameters of some directions. left:
       optical depth between them; far: depth of the far end below the face that e^(-k x) decays from; passed = left/mu,
       decayed = e^-passed, half its root, gone = 1 - decayed; passed is 0 where left is infinite. */
    int rows, upward, decaying;
    double left, far, thickness;
    const double *mu, *passed, *decayed, *half, *gone;
} vrte_arrival;

/* sinh(x)/x by its series; square: x^2, up to 1/4. */
VRTE_INLINE double vrte_sinh_over(double square) {
    double sum = 1.0 / 6227020800.0 + square * (1.0 / 1307674368000.0);
    sum = 1.0 / 362880.0 + square * (1.0 / 39916800.0 + square * sum);
    return 1.0 + square * (1.0 / 6.0 + square * (1.0 / 120.0 + square * (1.0 / 5040.0 + square * sum)));
}

/* (e^a - e^b)/(a - b), and e^a where they meet: e^((a + b)/2) sinh(x)/x with x = (a - b)/2 where these are close. */
static double vrte_exp_difference(double a, double b) {
    double gap = a - b;
    if (fabs(gap) > 1.0) return (exp(a) - exp(b)) / gap;
    return exp(0.5 * (a + b)) * vrte_sinh_over(0.25 * gap * gap);
}

/* Columns of the gains of one real mode, lam = k^2: amplitudes of the even and the odd mode to radiance, and
   (g_e -+ k g_f)/(1 + k mu) or /(k mu - 1), 0 near resonance. The integrals are those of `decaying_integrals` and
   `hyperbolic_integrals`; sine: the latter's, or NULL. */
VRTE_INLINE void vrte_real_gains(const vrte_arrival* p, double lam, const double* sine, const double* VRTE_OWN g_e,
                                 const double* VRTE_OWN g_f, double* VRTE_OWN even, double* VRTE_OWN odd,
                                 double* VRTE_OWN beam) {
    const double *VRTE_OWN mu = p->mu, *VRTE_OWN passed = p->passed, *VRTE_OWN decayed = p->decayed;
    const double *VRTE_OWN half = p->half, *VRTE_OWN gone = p->gone;
    const int rows = p->rows, upward = p->upward, endless = p->left > SEMI_INFINITE;
    const double k = sqrt(lam), along = endless ? 0.0 : p->left * k, mode_half = endless ? 0.0 : exp(-0.5 * along);
    const double mode_decayed = mode_half * mode_half, mode_gone = endless ? 1.0 : -expm1(-along);
    const double side = upward ? 1.0 : -1.0, slope = -side * k;
    const double at_far = !upward && p->thickness > SEMI_INFINITE ? 0.0 : exp(-p->far * k);
    for (int i = 0; i < rows; i++) {
        double ahead = 1.0 / (1.0 + mu[i] * k), behind = mu[i] * k + side, gap = passed[i] - along;
        double x = 0.25 * gap * gap, small = x < 0.25 ? x : 0.25;
        double distant = (mode_decayed - decayed[i]) / gap, wanted = 1.0 / behind; /* of no use where these are small */
        double near = mode_half * half[i] * vrte_sinh_over(small);
        even[i] = at_far * (mode_gone + mode_decayed * gone[i]) * ahead;
        odd[i] = passed[i] * (x > 0.25 ? distant : near);
        beam[i] = fabs(behind) < RESONANT ? 0.0 : wanted;
    }
    if (p->decaying) { /* y = e^(-k x), z = k y; y = e^(-k (thickness - x)), z = -k y; down, one is the other's image */
        for (int i = 0; i < rows; i++) {
            double first = upward ? even[i] : odd[i], second = upward ? odd[i] : even[i];
            double g = g_e[i], h = slope * g_f[i];
            even[i] = 0.5 * first * (g + h);
            odd[i] = 0.5 * second * (g - h);
            beam[i] *= g + h;
        }
    } else {
        const double whole = 1.0 / (1.0 + exp(-p->thickness * k)), per_rate = k > 0.0 ? whole / k : 0.0;
        for (int i = 0; i < rows; i++) {
            double c = (even[i] + odd[i]) * whole, s = sine ? sine[i] : (odd[i] - even[i]) * per_rate;
            even[i] = 0.5 * (c * g_e[i] + lam * s * g_f[i]);
            odd[i] = 0.5 * side * (s * g_e[i] + c * g_f[i]);
            beam[i] *= g_e[i] + slope * g_f[i];
        }
    }
}

VRTE_TWICE(void, vrte_real_gains,
           (const vrte_arrival* p, double lam, const double* sine, const double* g_e, const double* g_f, double* even,
            double* odd, double* beam),
           vrte_real_gains(p, lam, sine, g_e, g_f, even, odd, beam))
