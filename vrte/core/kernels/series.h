/* A phase matrix at angles of scattering, and turned to the meridian planes: `lanes` are of as many angles. A row of
   its table (SERIES) has the factors of d^{l+1} = (a x -+ b) d^l - c d^{l-1} (a, c of d_00; a, c of d_02; a, b, c of
   d_2,+-2), then the coefficients of F11, F44, F12, F34, F22 + F33, F22 - F33. */

/* Two degrees of d_00 and d_02, and what they add to F11, F44, F12, F34. */
VRTE_SHARED void vrte_add_two(STORED real* s, lanes x, lanes* p, lanes* p_old, lanes* q, lanes* q_old, lanes* f11,
                              lanes* f44, lanes* f12, lanes* f34) {
    STORED real* t = s + SERIES;
    const lanes p_next = s[0] * x * *p - s[1] * *p_old, q_next = s[2] * x * *q - s[3] * *q_old;
    *f11 += s[7] * *p + t[7] * p_next;
    *f44 += s[8] * *p + t[8] * p_next;
    *f12 += s[9] * *q + t[9] * q_next;
    *f34 += s[10] * *q + t[10] * q_next;
    *p = t[0] * x * p_next - t[1] * *p;
    *q = t[2] * x * q_next - t[3] * *q;
    *p_old = p_next;
    *q_old = q_next;
}

/* Two degrees of d_2,2 and d_2,-2, and what they add to F22 + F33, F22 - F33. */
VRTE_SHARED void vrte_add_two_polar(STORED real* s, lanes x, lanes* u, lanes* u_old, lanes* w, lanes* w_old, lanes* sum,
                                    lanes* difference) {
    STORED real* t = s + SERIES;
    const lanes u_next = (s[4] * x - s[5]) * *u - s[6] * *u_old, w_next = (s[4] * x + s[5]) * *w - s[6] * *w_old;
    *sum += s[11] * *u + t[11] * u_next;
    *difference += s[12] * *w + t[12] * w_next;
    *u = (t[4] * x - t[5]) * u_next - t[6] * *u;
    *w = (t[4] * x + t[5]) * w_next - t[6] * *w;
    *u_old = u_next;
    *w_old = w_next;
}

/* Degree 2 of d_00, d_02, d_2,2 and d_2,-2. */
VRTE_SHARED void vrte_start_series(lanes x, lanes* p, lanes* q, lanes* u, lanes* w) {
    *p = 1.5 * x * x - 0.5;
    *q = -0.6123724356957945 * (1.0 - x) * (1.0 + x); /* sqrt(6)/4 */
    *u = 0.25 * (1.0 + x) * (1.0 + x);
    *w = 0.25 * (1.0 - x) * (1.0 - x);
}

/* The cosine of the angle of scattering; sines: the product of both directions' sines. */
VRTE_SHARED lanes vrte_scattering_cosine(real sines, real mu0, real mu, lanes cos_phi) {
    const lanes x = sines * cos_phi - mu * mu0, one = 1.0;
    return x > one ? one : x < -one ? -one : x;
}

/* cos and sin of twice the angles from the scattering plane to the meridian planes, outgoing then incident. l is
   theta-hat, r = l x k; n, normal to the scattering plane, is k x k'; in a plane with r_s = n: cos(sigma) = n.r and
   sin(sigma) = -n.l. Straight on and straight back the meridian plane serves. */
VRTE_SHARED void vrte_turns(real mu0, real mu, real sine0, real sine, lanes cos_phi, lanes sin_phi, lanes* cos_out,
                            lanes* sin_out, lanes* cos_in, lanes* sin_in) {
    const lanes kx = sine * cos_phi, ky = sine * sin_phi; /* outgoing; incident: (sine0, 0, -mu0) */
    const lanes lx = mu * cos_phi, ly = mu * sin_phi, zero = 0.0;
    const lanes rx = ly * mu + sine * ky, ry = -sine * kx - lx * mu; /* l x k is horizontal */
    lanes nx = -ky * mu0, ny = mu * sine0 + kx * mu0, nz = -ky * sine0, c, s, length;
    const mask none = nx * nx + ny * ny + nz * nz < 1e-18;
    nx = none ? rx : nx;
    ny = none ? ry : ny;
    nz = none ? zero : nz;
    c = nx * rx + ny * ry;
    s = -(nx * lx + ny * ly - nz * sine);
    length = c * c + s * s;
    *cos_out = (c * c - s * s) / length;
    *sin_out = 2.0 * c * s / length;
    c = -ny; /* incident: l' = (-mu0, 0, -sine0), r' = l' x k' = (0, -1, 0) */
    s = nx * mu0 + nz * sine0;
    length = c * c + s * s;
    *cos_in = (c * c - s * s) / length;
    *sin_in = 2.0 * c * s / length;
}

/* The phase matrix times one column (g, h) within (I, Q), kind 0, or (U, V), kind 1. */
VRTE_SHARED void vrte_scatter_column(int kind, real g, real h, lanes f11, lanes f44, lanes f12, lanes f34, lanes sum,
                                     lanes difference, lanes c, lanes s, lanes c_in, lanes s_in, lanes* i, lanes* q,
                                     lanes* u, lanes* v) {
    const lanes f22 = 0.5 * (sum + difference), f33 = 0.5 * (sum - difference);
    lanes q_s, u_s; /* in the scattering plane */
    if (kind) {
        *i = f12 * s_in * g;
        q_s = f22 * s_in * g;
        u_s = f33 * c_in * g + f34 * h;
        *v = f44 * h - f34 * c_in * g;
    } else {
        *i = f11 * g + f12 * c_in * h;
        q_s = f12 * g + f22 * c_in * h;
        u_s = -f33 * s_in * h;
        *v = f34 * s_in * h;
    }
    *q = c * q_s - s * u_s;
    *u = s * q_s + c * u_s;
}
