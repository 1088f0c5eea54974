/* Complex numbers, and divided differences of exp: with them every resonance (mu0 on a node, on the reciprocal of an
   eigenvalue, mu = mu0) is an ordinary case. */

typedef struct {
    real x, y;
} vrte_complex;

VRTE_SHARED vrte_complex vrte_pair(real x, real y) {
    vrte_complex z;
    z.x = x;
    z.y = y;
    return z;
}

VRTE_SHARED vrte_complex vrte_plus(vrte_complex a, vrte_complex b) { return vrte_pair(a.x + b.x, a.y + b.y); }
VRTE_SHARED vrte_complex vrte_minus(vrte_complex a, vrte_complex b) { return vrte_pair(a.x - b.x, a.y - b.y); }
VRTE_SHARED vrte_complex vrte_scaled(real f, vrte_complex a) { return vrte_pair(f * a.x, f * a.y); }

VRTE_SHARED vrte_complex vrte_times(vrte_complex a, vrte_complex b) {
    return vrte_pair(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
}

/* a / b; every caller keeps |b|^2 in range. */
VRTE_SHARED vrte_complex vrte_over(vrte_complex a, vrte_complex b) {
    const real size = b.x * b.x + b.y * b.y;
    if (b.y == 0.0) return vrte_pair(a.x / b.x, a.y / b.x);
    return vrte_pair((a.x * b.x + a.y * b.y) / size, (a.y * b.x - a.x * b.y) / size);
}

VRTE_SHARED real vrte_size(vrte_complex a) { return a.y == 0.0 ? fabs(a.x) : hypot(a.x, a.y); }

VRTE_SHARED vrte_complex vrte_exp(vrte_complex z) {
    const real scale = exp(z.x);
    if (z.y == 0.0) return vrte_pair(scale, 0.0);
    return vrte_pair(scale * cos(z.y), scale * sin(z.y));
}

VRTE_SHARED vrte_complex vrte_expm1(vrte_complex z) {
    real half_sine;
    if (z.y == 0.0) return vrte_pair(expm1(z.x), 0.0);
    half_sine = sin(0.5 * z.y);
    return vrte_pair(expm1(z.x) * cos(z.y) - 2.0 * half_sine * half_sine, exp(z.x) * sin(z.y));
}

/* The root with a non-negative real part. */
VRTE_SHARED vrte_complex vrte_sqrt(vrte_complex z) {
    real size, re;
    if (z.y == 0.0) return z.x >= 0.0 ? vrte_pair(sqrt(z.x), 0.0) : vrte_pair(0.0, sqrt(-z.x));
    size = hypot(z.x, z.y);
    re = z.x >= 0.0 ? sqrt(0.5 * (size + z.x)) : 0.5 * fabs(z.y) / sqrt(0.5 * (size - z.x));
    return vrte_pair(re, 0.5 * z.y / re);
}

/* sinh(x)/x by its series; square: x^2, up to 1/4. */
VRTE_SHARED real vrte_sinh_over(real square) {
    real sum = 1.0 / 6227020800.0 + square * (1.0 / 1307674368000.0);
    sum = 1.0 / 362880.0 + square * (1.0 / 39916800.0 + square * sum);
    return 1.0 + square * (1.0 / 6.0 + square * (1.0 / 120.0 + square * (1.0 / 5040.0 + square * sum)));
}

/* (e^a - e^b)/(a - b), and e^a where they meet: e^((a + b)/2) sinh(x)/x with x = (a - b)/2 where these are close. */
VRTE_SHARED real vrte_exp_difference(real a, real b) {
    const real gap = a - b;
    if (fabs(gap) > 1.0) return (exp(a) - exp(b)) / gap;
    return exp(0.5 * (a + b)) * vrte_sinh_over(0.25 * gap * gap);
}

/* exp[a, b], the same of complex numbers. */
VRTE_SHARED vrte_complex vrte_exp_difference_of(vrte_complex a, vrte_complex b) {
    const vrte_complex high = a.x < b.x ? b : a, low = a.x < b.x ? a : b, gap = vrte_minus(low, high);
    const real size = vrte_size(gap);
    if (a.y == 0.0 && b.y == 0.0) return vrte_pair(vrte_exp_difference(a.x, b.x), 0.0);
    if (size == 0.0) return vrte_exp(high);
    if (size > 1.0) return vrte_over(vrte_minus(vrte_exp(low), vrte_exp(high)), gap);
    return vrte_times(vrte_exp(high), vrte_over(vrte_expm1(gap), gap));
}

/* exp[a, b, c], the second divided difference, for any spacing of its arguments. */
VRTE_SHARED vrte_complex vrte_second_difference(vrte_complex a, vrte_complex b, vrte_complex c) {
    const real ab = vrte_size(vrte_minus(a, b)), bc = vrte_size(vrte_minus(b, c)), ca = vrte_size(vrte_minus(c, a));
    const vrte_complex first = a, second = b, third = c, one = vrte_pair(1.0, 0.0);
    vrte_complex centre, h1 = one, h2 = one, h3 = one, total = vrte_pair(0.5, 0.0);
    real widest = ca, factor = 0.5;
    if (ab >= bc && ab >= ca) { /* the outer pair goes to a and c */
        b = third;
        c = second;
        widest = ab;
    } else if (bc >= ca) {
        a = second;
        b = first;
        widest = bc;
    }
    if (widest > 1.0)
        return vrte_over(vrte_minus(vrte_exp_difference_of(a, b), vrte_exp_difference_of(b, c)), vrte_minus(a, c));
    centre = vrte_plus(vrte_plus(a, b), c);
    centre = vrte_pair(centre.x / 3.0, centre.y / 3.0);
    a = vrte_minus(a, centre);
    b = vrte_minus(b, centre);
    c = vrte_minus(c, centre);
    for (int i = 1; i < 18; i++) { /* complete homogeneous polynomials of 1, 2, 3 offsets */
        h1 = vrte_times(a, h1);
        h2 = vrte_plus(h1, vrte_times(b, h2));
        h3 = vrte_plus(h2, vrte_times(c, h3));
        factor = factor / (i + 2);
        total = vrte_plus(total, vrte_scaled(factor, h3));
    }
    return vrte_times(vrte_exp(centre), total);
}
