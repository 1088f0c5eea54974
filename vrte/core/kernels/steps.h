/* Scalars that steer fixed points of invariance, and doublings. */

/* Of both 2 x 2 blocks of B_l = (a1, a2, a3, a4, b1, b2), the larger norm, or a little more. */
VRTE_SHARED real vrte_norm_of_degree(real a1, real a2, real a3, real a4, real b1, real b2) {
    const real first = 0.5 * fabs(a1 + a2) + hypot(0.5 * (a1 - a2), b1);
    return fmax(first, fmax(fabs(a3), fabs(a4)) + fabs(b2));
}

/* What is missing after a step that moved by `gap` and gains `rate` at least, relative to the largest element. */
VRTE_SHARED real vrte_missing(real gap, real rate, real largest) {
    return largest > 0.0 ? gap * rate / (1.0 - rate) / largest : 1.0;
}

/* Anderson's acceleration: fractions of what the last three steps led to, the latest first, that would have moved
   least; product_ij: scalar products of what the steps moved. */
VRTE_SHARED void vrte_accelerate(int steps, real product_00, real product_01, real product_02, real product_11,
                                 real product_12, real product_22, real* fraction) {
    const real a11 = product_00 - 2.0 * product_01 + product_11, b1 = product_00 - product_01;
    const real a12 = product_01 - product_02 - product_11 + product_12, b2 = product_01 - product_02;
    const real a22 = product_11 - 2.0 * product_12 + product_22, det = a11 * a22 - a12 * a12;
    real g1 = 0.0, g2 = 0.0;
    if (steps > 1 && det > INDEPENDENT * a11 * a22) {
        g1 = (b1 * a22 - b2 * a12) / det;
        g2 = (b2 * a11 - b1 * a12) / det;
    }
    if (steps > 0 && g2 == 0.0 && a11 > 0.0) g1 = b1 / a11;
    if (g1 == 0.0) g2 = 0.0;
    fraction[0] = 1.0 - g1;
    fraction[1] = g1 - g2;
    fraction[2] = g2;
}

/* 1 - tanh(x)^2 = 1/cosh(x)^2, without a difference. */
VRTE_SHARED real vrte_over_cosh_squared(real x) {
    const real e = exp(-2.0 * x);
    return 4.0 * e / ((1.0 + e) * (1.0 + e));
}

/* The smallest over the largest eigenvalue of sqrt(Zo Ze) after a doubling, by x -> 2 (x/sqrt(used))/(1 + x^2/used) of
   the two ends; used: the ratio before, or STEEPEST_RATIO where that is larger. */
VRTE_SHARED real vrte_doubled_ratio(real ratio, real used) {
    return fmin(2.0 * ratio * sqrt(used) / (used + ratio * ratio), 2.0 * sqrt(used) / (1.0 + used));
}
