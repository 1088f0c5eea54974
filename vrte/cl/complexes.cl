// Complex numbers (re, im) as double2, and divided differences of exp, which make every resonance (mu0 on a node, on
// the reciprocal of an eigenvalue, mu = mu0) an ordinary case: those of _core.pyx.

double2 times(double2 a, double2 b)
{
    return (double2)(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
}

// a / b; every caller keeps |b|^2 in range.
double2 over(double2 a, double2 b)
{
    if (b.y == 0.0)
        return (double2)(a.x / b.x, a.y / b.x);
    const double size = b.x * b.x + b.y * b.y;
    return (double2)((a.x * b.x + a.y * b.y) / size, (a.y * b.x - a.x * b.y) / size);
}

double size_of(double2 a)
{
    return a.y == 0.0 ? fabs(a.x) : hypot(a.x, a.y);
}

double2 c_exp(double2 z)
{
    const double scale = exp(z.x);
    if (z.y == 0.0)
        return (double2)(scale, 0.0);
    return (double2)(scale * cos(z.y), scale * sin(z.y));
}

double2 c_expm1(double2 z)
{
    if (z.y == 0.0)
        return (double2)(expm1(z.x), 0.0);
    const double half_sine = sin(0.5 * z.y);
    return (double2)(expm1(z.x) * cos(z.y) - 2.0 * half_sine * half_sine, exp(z.x) * sin(z.y));
}

// The root with a non-negative real part.
double2 c_sqrt(double2 z)
{
    if (z.y == 0.0)
        return z.x >= 0.0 ? (double2)(sqrt(z.x), 0.0) : (double2)(0.0, sqrt(-z.x));
    const double size = hypot(z.x, z.y);
    const double re = z.x >= 0.0 ? sqrt(0.5 * (size + z.x)) : 0.5 * fabs(z.y) / sqrt(0.5 * (size - z.x));
    return (double2)(re, 0.5 * z.y / re);
}

// exp[a, b] = (e^a - e^b)/(a - b), and e^a where they meet.
double2 exp_difference(double2 a, double2 b)
{
    const double2 high = a.x < b.x ? b : a, low = a.x < b.x ? a : b, gap = low - high;
    const double size = size_of(gap);
    if (size == 0.0)
        return c_exp(high);
    if (size > 1.0)
        return over(c_exp(low) - c_exp(high), gap);
    return times(c_exp(high), over(c_expm1(gap), gap));
}

// exp[a, b, c], the second divided difference, for any spacing of its arguments.
double2 exp_difference_2(double2 a, double2 b, double2 c)
{
    const double ab = size_of(a - b), bc = size_of(b - c), ca = size_of(c - a);
    double widest = ca;
    if (ab >= bc && ab >= ca) {      // the outer pair goes to a and c
        const double2 kept = b;
        b = c;
        c = kept;
        widest = ab;
    } else if (bc >= ca) {
        const double2 kept = a;
        a = b;
        b = kept;
        widest = bc;
    }
    if (widest > 1.0)
        return over(exp_difference(a, b) - exp_difference(b, c), a - c);
    const double2 centre = (a + b + c) / 3.0, one = (double2)(1.0, 0.0);
    double2 h1 = one, h2 = one, h3 = one, total = 0.5 * one;     // complete homogeneous polynomials of 1, 2, 3 offsets
    double factor = 0.5;
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
double2 beam_response(double2 k, double rate, double depth)
{
    return depth * exp_difference((double2)(-depth * rate, 0.0), -depth * k);
}
