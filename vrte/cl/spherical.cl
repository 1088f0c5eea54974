// Generalized spherical functions: Wigner's d^l_{m,0}, d^l_{m,2}, d^l_{m,-2} of one direction, degree after degree.

typedef struct
{
    real zero, plus, minus;                        // at the degree l
    real zero_before, plus_before, minus_before;   // at l - 1
} Wigner;

real to_the_power(real x, int m)
{
    real result = 1.0;
    while (m > 0) {
        if (m & 1)
            result *= x;
        x *= x;
        m >>= 1;
    }
    return result;
}

// Degree m; the polar ones begin at max(m, 2): `polar_start`.
Wigner wigner_start(int m, real mu, real factor)
{
    Wigner w = {factor * to_the_power(sqrt((1.0 - mu) * (1.0 + mu)), m), 0.0, 0.0, 0.0, 0.0, 0.0};
    return w;
}

void polar_start(int m, real mu, real growth, Wigner* w)
{
    const real sine = sqrt((1.0 - mu) * (1.0 + mu));
    if (m == 0)
        w->plus = w->minus = sqrt(6.0) / 4.0 * sine * sine;
    else if (m == 1) {
        w->plus = 0.5 * sine * (1.0 + mu);
        w->minus = -0.5 * sine * (1.0 - mu);
    } else {
        const real power = 0.25 * growth * to_the_power(sine, m - 2);
        w->plus = (1.0 + mu) * (1.0 + mu) * power;
        w->minus = (1.0 - mu) * (1.0 - mu) * power;
    }
}

// From l to l + 1; factors: lower and upper one for k = 0, then for k = +-2, whole numbers where m = 0.
void wigner_step(int m, int l, bool polar, real mu, real4 factors, Wigner* w)
{
    const real odd = 2.0 * l + 1.0, steep = (real)l * (l + 1.0), shift = 2.0 * m;
    const real zero = l == 0 ? mu : (odd * (steep * mu) * w->zero - factors.x * w->zero_before) / factors.y;
    w->zero_before = w->zero;
    w->zero = zero;
    if (polar && l >= 2) {
        const real plus = (odd * (steep * mu - shift) * w->plus - factors.z * w->plus_before) / factors.w;
        const real minus = (odd * (steep * mu + shift) * w->minus - factors.z * w->minus_before) / factors.w;
        w->plus_before = w->plus;
        w->minus_before = w->minus;
        w->plus = plus;
        w->minus = minus;
    }
}

real below(int m, real l, real k)
{
    return sqrt((l * l - (real)m * m) * (l * l - k * k));
}

// What all directions of an item share: factors (item, n_term + 1, 4) of each step, the starts' factor and growth last.
// Pieces: items.
SHARED
__kernel void wigner_factors(int n_term, INTS order, OUT factors, INTS items)
{
    const long item = items[get_group_id(0)];
    const int m = order[item];
    real factor = m % 2 ? -1.0 : 1.0, growth = factor;
    factors += item * 4 * (n_term + 1);
    for (int j = 1; j <= m; j++)
        factor *= sqrt((2.0 * j - 1.0) / (2.0 * j));
    for (int j = 2; j < m; j++)
        growth *= 0.5 * sqrt((2.0 * j + 2.0) * (2.0 * j + 1.0) / ((j - 1.0) * (j + 3.0)));
    SPREAD(l, m, n_term) {
        const bool polar = l >= 2;
        PUT(factors, l) = (real4)((l + 1.0) * below(m, l, 0.0), l * below(m, l + 1.0, 0.0),
                                    polar ? (l + 1.0) * below(m, l, 2.0) : 0.0, polar ? l * below(m, l + 1.0, 2.0) : 1.0);
    }
    if (LANE == 0)
        PUT(factors, n_term) = (real4)(factor, growth, 0.0, 0.0);
}
