#pragma once
#include "kernels/in_c.h"

typedef struct {
    /* What arrives at a depth of a layer from its far face, by rows: the Stokes parameters of some directions. left:
       optical depth between them; far: depth of the far end below the face that e^(-k x) decays from; passed = left/mu,
       decayed = e^-passed, half its root, gone = 1 - decayed; passed is 0 where left is infinite. moments: those of
       `vrte_odd_moments`, or NULL where k thickness > 1 for every mode. */
    int rows, upward, decaying;
    double left, far, thickness;
    const double *mu, *passed, *decayed, *half, *gone, *moments;
} vrte_arrival;

enum { VRTE_MOMENTS = 7 }; /* terms of sinh(x)/x that count for x up to 1/2 */

/* moments (VRTE_MOMENTS, rows): of t, t^3, t^5, ... times e^(-(x - far)/mu) dx/mu over x from far to the bottom, t from
   -1 at a layer's top to 1 at its bottom. Gauss's rule where e^(-left/mu) is smooth, else integration by parts. */
static void vrte_odd_moments(const vrte_arrival* p, double* moments) {
    static const double at[5] = {0.1488743389816312, 0.4333953941292472, 0.6794095682990244, 0.8650633666889845,
                                 0.9739065285171717};
    static const double weight[5] = {0.2955242247147529, 0.2692667193099963, 0.2190863625159821, 0.1494513491505806,
                                     0.0666713443086881};
    const double half = 0.5 * p->thickness, top = 2.0 * (p->far / p->thickness) - 1.0, middle = 0.5 * (top + 1.0);
    for (int i = 0; i < p->rows; i++) {
        const double x = p->passed[i], around = 0.5 * (1.0 - top);
        double sum[VRTE_MOMENTS] = {0.0}, moment = p->gone[i], power = 1.0;
        if (i > 0 && p->mu[i] == p->mu[i - 1]) {
            for (int j = 0; j < VRTE_MOMENTS; j++) moments[j * p->rows + i] = moments[j * p->rows + i - 1];
            continue;
        }
        for (int k = 0; k < (x < 4.0 ? 10 : 0); k++) {
            const double s = k < 5 ? at[k] : -at[k - 5], t = middle + around * s;
            double term = 0.5 * x * weight[k % 5] * p->half[i] * exp(-0.5 * x * s) * t;
            for (int j = 0; j < VRTE_MOMENTS; j++, term *= t * t) sum[j] += term;
        }
        for (int n = 1; n < (x < 4.0 ? 0 : 2 * VRTE_MOMENTS); n++) {
            power *= top;
            moment = power - p->decayed[i] + n * (p->mu[i] / half) * moment;
            if (n & 1) sum[n / 2] = moment;
        }
        for (int j = 0; j < VRTE_MOMENTS; j++) moments[j * p->rows + i] = sum[j];
    }
}

/* Columns of the gains of one real mode, lam = k^2: amplitudes of the even and the odd mode to radiance, and
   (g_e -+ k g_f)/(1 + k mu) or /(k mu - 1), 0 near resonance. The integrals are those of `vrte_decaying_integrals` and
   `vrte_hyperbolic_integrals`, that over sinh of a thin layer by the series of sinh and the moments. */
VRTE_INLINE void vrte_real_gains(const vrte_arrival* p, double lam, const double* VRTE_OWN g_e,
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
        const int flat = p->moments && k * p->thickness <= 1.0;
        const double square = 0.25 * lam * p->thickness * p->thickness;
        double factor = p->thickness * whole * exp(-0.5 * p->thickness * k); /* half of it over cosh */
        if (flat) {
            const double* VRTE_OWN m = p->moments;
            double f[VRTE_MOMENTS];
            for (int j = 0; j < VRTE_MOMENTS; j++) {
                f[j] = factor;
                factor *= square / ((2.0 * j + 2.0) * (2.0 * j + 3.0));
            }
            for (int i = 0; i < rows; i++) {
                double s = f[0] * m[i];
                for (int j = 1; j < VRTE_MOMENTS; j++) s += f[j] * m[j * rows + i];
                even[i] = (even[i] + odd[i]) * whole;
                odd[i] = s;
            }
        }
        for (int i = 0; i < rows; i++) {
            double c = flat ? even[i] : (even[i] + odd[i]) * whole, s = flat ? odd[i] : (odd[i] - even[i]) * per_rate;
            even[i] = 0.5 * (c * g_e[i] + lam * s * g_f[i]);
            odd[i] = 0.5 * side * (s * g_e[i] + c * g_f[i]);
            beam[i] *= g_e[i] + slope * g_f[i];
        }
    }
}

VRTE_TWICE(void, vrte_real_gains,
           (const vrte_arrival* p, double lam, const double* g_e, const double* g_f, double* even, double* odd,
            double* beam),
           vrte_real_gains(p, lam, g_e, g_f, even, odd, beam))
