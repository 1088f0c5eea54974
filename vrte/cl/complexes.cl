// Complex numbers (re, im) as double2, and divided differences of exp, which make every resonance (mu0 on a node, on
// the reciprocal of an eigenvalue, mu = mu0) an ordinary case: those of _core.pyx.

real2 times(real2 a, real2 b)
{
    return (real2)(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
}

// a / b; every caller keeps |b|^2 in range.
real2 over(real2 a, real2 b)
{
    if (b.y == 0.0)
        return (real2)(a.x / b.x, a.y / b.x);
    const real size = b.x * b.x + b.y * b.y;
    return (real2)((a.x * b.x + a.y * b.y) / size, (a.y * b.x - a.x * b.y) / size);
}

real size_of(real2 a)
{
    return a.y == 0.0 ? fabs(a.x) : hypot(a.x, a.y);
}

real2 c_exp(real2 z)
{
    const real scale = exp(z.x);
    if (z.y == 0.0)
        return (real2)(scale, 0.0);
    return (real2)(scale * cos(z.y), scale * sin(z.y));
}

real2 c_expm1(real2 z)
{
    if (z.y == 0.0)
        return (real2)(expm1(z.x), 0.0);
    const real half_sine = sin(0.5 * z.y);
    return (real2)(expm1(z.x) * cos(z.y) - 2.0 * half_sine * half_sine, exp(z.x) * sin(z.y));
}

// The root with a non-negative real part.
real2 c_sqrt(real2 z)
{
    if (z.y == 0.0)
        return z.x >= 0.0 ? (real2)(sqrt(z.x), 0.0) : (real2)(0.0, sqrt(-z.x));
    const real size = hypot(z.x, z.y);
    const real re = z.x >= 0.0 ? sqrt(0.5 * (size + z.x)) : 0.5 * fabs(z.y) / sqrt(0.5 * (size - z.x));
    return (real2)(re, 0.5 * z.y / re);
}

// exp[a, b] = (e^a - e^b)/(a - b), and e^a where they meet.
real2 exp_difference(real2 a, real2 b)
{
    const real2 high = a.x < b.x ? b : a, low = a.x < b.x ? a : b, gap = low - high;
    const real size = size_of(gap);
    if (size == 0.0)
        return c_exp(high);
    if (size > 1.0)
        return over(c_exp(low) - c_exp(high), gap);
    return times(c_exp(high), over(c_expm1(gap), gap));
}

// exp[a, b, c], the second divided difference, for any spacing of its arguments.
real2 exp_difference_2(real2 a, real2 b, real2 c)
{
    const real ab = size_of(a - b), bc = size_of(b - c), ca = size_of(c - a);
    real widest = ca;
    if (ab >= bc && ab >= ca) {      // the outer pair goes to a and c
        const real2 kept = b;
        b = c;
        c = kept;
        widest = ab;
    } else if (bc >= ca) {
        const real2 kept = a;
        a = b;
        b = kept;
        widest = bc;
    }
    if (widest > 1.0)
        return over(exp_difference(a, b) - exp_difference(b, c), a - c);
    const real2 centre = (a + b + c) / 3.0, one = (real2)(1.0, 0.0);
    real2 h1 = one, h2 = one, h3 = one, total = 0.5 * one;     // complete homogeneous polynomials of 1, 2, 3 offsets
    real factor = 0.5;
    a -= centre;
    b -= centre;
    c -= centre;
    for (int i = 1; i < 18; i++) {
        h1 = times(a, h1);
        h2 = h1 + times(b, h2);
        h3 = h2 + times(c, h3);
        factor /= i + 2;
        total += factor * h3;
    }
    return times(c_exp(centre), total);
}

// D(depth) = (e^(-depth rate) - e^(-k depth))/(k - rate), unit optical depth.
real2 beam_response(real2 k, real rate, real depth)
{
    return depth * exp_difference((real2)(-depth * rate, 0.0), -depth * k);
}
