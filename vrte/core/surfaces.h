#pragma once
#include "kernels/in_c.h"

/* Flat surfaces, and facets of random slopes. */

/* Fresnel's r_p, r_s of a flat surface of relative index m where c is the cosine of incidence: (m^2 c - root)/(m^2 c +
   root) and (c - root)/(c + root), root = m times the cosine inside, which is what comes back. */
VRTE_SHARED vrte_complex vrte_fresnel(vrte_complex m, real c, vrte_complex* p, vrte_complex* s) {
    const vrte_complex square = vrte_times(m, m), one = vrte_pair(1.0, 0.0), along = vrte_scaled(c, square);
    vrte_complex root = vrte_times(vrte_minus(m, one), vrte_plus(m, one)); /* m^2 - 1, without a difference */
    root.x += c * c;
    if (root.y == 0.0 && root.x >= 0.0) {
        root.x = sqrt(root.x);
    } else {
        root = vrte_sqrt(root);
        if (root.y < 0.0) root = vrte_scaled(-1.0, root);
    }
    *s = vrte_over(vrte_pair(c - root.x, -root.y), vrte_pair(c + root.x, root.y));
    *p = vrte_over(vrte_minus(along, root), vrte_plus(along, root));
    return root;
}

/* The share of facets turned towards a direction that others do not hide, after Smith. */
VRTE_SHARED real vrte_smith(real alpha, int is_ggx, real mu) {
    const real sine = sqrt((1.0 - mu) * (1.0 + mu));
    real slope, hidden;
    if (sine == 0.0) return 1.0;
    slope = mu / (alpha * sine);
    if (!is_ggx) slope = fmin(slope, 30.0);
    hidden = is_ggx ? 1.0 / (slope * slope * (1.0 + sqrt(1.0 + 1.0 / (slope * slope))))
                    : exp(-slope * slope) / (slope * 1.7724538509055160273) - erfc(slope);
    return 1.0 / (1.0 + 0.5 * hidden);
}
