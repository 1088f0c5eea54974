/* Integrals over the path of light along mu through a part of a layer, unit optical depth. left: optical depth of that
   part; far: depth of its far end below the face that a mode e^(-k x) decays from. */

/* D(depth) = (e^(-depth rate) - e^(-k depth))/(k - rate). */
VRTE_SHARED vrte_complex vrte_beam_response(vrte_complex k, real rate, real depth) {
    return vrte_scaled(depth, vrte_exp_difference_of(vrte_pair(-depth * rate, 0.0), vrte_scaled(-depth, k)));
}

/* int e^(-x/mu0) e^(-|x - depth|/mu) dx/mu over what lies below a depth (upward) or above it. */
VRTE_SHARED real vrte_beam_path(int upward, real mu, real mu0, real left, real depth) {
    const real rate = 1.0 / mu + 1.0 / mu0;
    if (upward) return exp(-depth / mu0) * -expm1(-left * rate) / (mu * rate);
    return (depth / mu) * vrte_exp_difference(-depth / mu0, -depth / mu);
}

/* 1 + mu k. */
VRTE_SHARED vrte_complex vrte_rate_ahead(vrte_complex k, real mu) { return vrte_pair(1.0 + mu * k.x, mu * k.y); }

/* int e^(-k x) from the face that the far end is measured from, and int e^(-k (thickness - x)) from the other, times
   e^(-|x - depth|/mu) dx/mu. */
VRTE_SHARED void vrte_decaying_integrals(vrte_complex k, real mu, real left, real far, vrte_complex* from_near,
                                         vrte_complex* from_other) {
    const vrte_complex decay = vrte_exp(vrte_scaled(-far, k)), ahead = vrte_rate_ahead(k, mu);
    *from_near = *from_other = vrte_pair(0.0, 0.0);
    if (left > SEMI_INFINITE) {
        *from_near = vrte_over(decay, ahead);
        return;
    }
    if (far < SEMI_INFINITE) {
        const vrte_complex whole = vrte_scaled(-left, vrte_pair(k.x + 1.0 / mu, k.y));
        *from_near = vrte_over(vrte_times(decay, vrte_scaled(-1.0, vrte_expm1(whole))), ahead);
    }
    *from_other = vrte_scaled(left / mu, vrte_exp_difference_of(vrte_scaled(-left, k), vrte_pair(-left / mu, 0.0)));
}

/* int cosh(k t)/cosh(k h) and int sinh(k t)/(k cosh(k h)) times the same, t the depth from the layer's middle, h half
   its thickness. */
VRTE_SHARED void vrte_hyperbolic_integrals(vrte_complex k, real mu, real left, real far, vrte_complex* cosine,
                                           vrte_complex* sine) {
    const real thickness = left + far, h = 0.5 * thickness;
    const vrte_complex zero = vrte_pair(0.0, 0.0), one = vrte_pair(1.0, 0.0);
    const vrte_complex whole = vrte_plus(one, vrte_exp(vrte_scaled(-thickness, k)));
    const vrte_complex along = vrte_scaled(left, k), passed = vrte_pair(left / mu, 0.0);
    const vrte_complex plus = vrte_minus(along, passed), minus = vrte_minus(vrte_scaled(-1.0, along), passed);
    vrte_complex from_near, from_other, u, v;
    vrte_decaying_integrals(k, mu, left, far, &from_near, &from_other);
    *cosine = vrte_over(vrte_plus(from_near, from_other), whole);
    if (vrte_size(k) * thickness > 1.0) {
        *sine = vrte_over(vrte_minus(from_other, from_near), vrte_times(k, whole));
        return;
    }
    /* near k = 0: e^(k(far - h)) times int e^(k(x - far)) ..., differenced between k and -k */
    u = vrte_scaled(2.0 * (far - h), vrte_exp_difference_of(vrte_scaled(far - h, k), vrte_scaled(h - far, k)));
    v = vrte_scaled(left / mu, vrte_exp_difference_of(zero, plus));
    u = vrte_scaled(0.5, vrte_times(u, v));
    v = vrte_scaled(2.0 * left * left / mu, vrte_second_difference(zero, plus, minus));
    u = vrte_plus(u, vrte_scaled(0.5, vrte_times(vrte_exp(vrte_scaled(h - far, k)), v)));
    v = vrte_scaled(0.5, vrte_plus(vrte_exp(vrte_scaled(h, k)), vrte_exp(vrte_scaled(-h, k))));
    *sine = vrte_over(u, v);
}

/* What radiance in a row of g_e = G_E X and g_f = G_F Y gets of the amplitudes of an even and an odd mode, or, where
   modes decay, of those from the top and from the bottom, and of the beam's part, (g_e -+ k g_f)/(mu k +- 1), left out
   near resonance: factors of g_e and of g_f each. */
typedef struct {
    vrte_complex even[2], odd[2], beam[2];
} vrte_mode_gains;

VRTE_SHARED vrte_mode_gains vrte_gains_of_mode(vrte_complex k, int upward, int decaying, real mu, real left, real far) {
    const real sign = upward ? -1.0 : 1.0;
    const vrte_complex slope = vrte_scaled(sign, k), behind = vrte_pair(mu * k.x - sign, mu * k.y);
    vrte_complex even, odd;
    vrte_mode_gains found;
    found.beam[0] = vrte_size(behind) < RESONANT ? vrte_pair(0.0, 0.0) : vrte_over(vrte_pair(1.0, 0.0), behind);
    found.beam[1] = vrte_times(found.beam[0], slope);
    if (decaying) {
        vrte_decaying_integrals(k, mu, left, far, &even, &odd);
        found.even[0] = vrte_scaled(0.5, upward ? even : odd);
        found.even[1] = vrte_times(found.even[0], slope);
        found.odd[0] = vrte_scaled(0.5, upward ? odd : even);
        found.odd[1] = vrte_scaled(-1.0, vrte_times(found.odd[0], slope));
        return found;
    }
    vrte_hyperbolic_integrals(k, mu, left, far, &even, &odd);
    found.even[0] = vrte_scaled(0.5, even);
    found.even[1] = vrte_scaled(0.5, vrte_times(vrte_times(k, k), odd));
    found.odd[0] = vrte_scaled(-0.5 * sign, odd);
    found.odd[1] = vrte_scaled(-0.5 * sign, even);
    return found;
}

/* re + i im = a gain times (e, f), of as many Stokes parameters as there are lanes. */
VRTE_SHARED void vrte_apply_gain(const vrte_complex* gain, lanes e_re, lanes e_im, lanes f_re, lanes f_im, lanes* re,
                                 lanes* im) {
    *re = gain[0].x * e_re - gain[0].y * e_im + (gain[1].x * f_re - gain[1].y * f_im);
    *im = gain[0].x * e_im + gain[0].y * e_re + (gain[1].x * f_im + gain[1].y * f_re);
}
