/* Wigner's functions d^l_{m,0}, d^l_{m,2}, d^l_{m,-2} of a direction, degree after degree. */

/* x^m, m >= 0. */
VRTE_SHARED real vrte_power(real x, int m) {
    real result = 1.0;
    for (; m > 0; m >>= 1) {
        if (m & 1) result *= x;
        x *= x;
    }
    return result;
}

/* d^m_{m,0} over sine^m, and d^m_{m,+-2} over (1 +- mu)^2 sine^(m - 2)/4. */
VRTE_SHARED real vrte_start_factor(int m) {
    real factor = m % 2 ? -1.0 : 1.0;
    for (int j = 1; j <= m; j++) factor *= sqrt((2.0 * j - 1.0) / (2.0 * j));
    return factor;
}

VRTE_SHARED real vrte_polar_factor(int m) {
    real factor = m % 2 ? -1.0 : 1.0;
    for (int j = 2; j < m; j++) factor *= 0.5 * sqrt((2.0 * j + 2.0) * (2.0 * j + 1.0) / ((j - 1.0) * (j + 3.0)));
    return factor;
}

/* d^m_{m,0}; d^l_{m,2} and d^l_{m,-2} at l = max(m, 2). */
VRTE_SHARED real vrte_wigner_start(int m, real mu, real factor) {
    return factor * vrte_power(sqrt((1.0 - mu) * (1.0 + mu)), m);
}

VRTE_SHARED void vrte_polar_start(int m, real mu, real factor, real* plus, real* minus) {
    const real sine = sqrt((1.0 - mu) * (1.0 + mu)), power = 0.25 * factor * vrte_power(sine, m - 2);
    if (m == 0) {
        *plus = *minus = sqrt(6.0) / 4.0 * sine * sine;
    } else if (m == 1) {
        *plus = 0.5 * sine * (1.0 + mu);
        *minus = -0.5 * sine * (1.0 - mu);
    } else {
        *plus = (1.0 + mu) * (1.0 + mu) * power;
        *minus = (1.0 - mu) * (1.0 - mu) * power;
    }
}

/* Factors of a step from l to l + 1, of d^{l-1} and of d^{l+1}: whole numbers where m = 0, since rounded ones would
   make P_l and 1 overlap at every node alike. */
VRTE_SHARED real vrte_wigner_lower(int m, int k, real l) {
    return (l + 1.0) * sqrt((l * l - (real)m * m) * (l * l - (real)k * k));
}

VRTE_SHARED real vrte_wigner_upper(int m, int k, real l) {
    return l * sqrt(((l + 1.0) * (l + 1.0) - (real)m * m) * ((l + 1.0) * (l + 1.0) - (real)k * k));
}

/* d^{l+1}_{m,k}, l > 0, from d^l and d^{l-1}. */
VRTE_SHARED real vrte_wigner_next(int m, int k, int l, real mu, real lower, real upper, real now, real before) {
    const real odd = 2.0 * l + 1.0, steep = (real)l * (l + 1.0), shift = (real)m * k;
    return (odd * (steep * mu - shift) * now - lower * before) / upper;
}
