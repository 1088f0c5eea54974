// The columns of P_l^m and what they make: phase matrices, and E and F of (1:41), with the rows and columns that lead out
// of and into the nodes. members: bit a is set where Stokes parameter a is of the set.

// From P_l^m the columns (I; Q and U) where l - m has the parity of the matrix, E even and F odd, else (Q and U; V).
int columns_of_kind(int m, int members, int kind)
{
    const int turns = m > 0;   // t_l^0 = 0
    const int first = kind ? members & (turns ? 6 : 4) : members & 1;
    const int second = kind ? members & 8 : members & (turns ? 6 : 2);
    return (first != 0) + (second != 0);
}

bool has_first(int m, int members, int kind)
{
    return kind ? (members & (m > 0 ? 6 : 4)) != 0 : (members & 1) != 0;
}

// The members' entries of a Stokes vector, one below the other.
void put_members(__global real* to, int members, real4 value)
{
    if (members == 15) {
        PUT(to, 0) = value;
        return;
    }
    if (members & 1)
        *to++ = value.x;
    if (members & 2)
        *to++ = value.y;
    if (members & 4)
        *to++ = value.z;
    if (members & 8)
        *to = value.w;
}

// What all directions of an item share of Wigner's functions. Pieces: items.
KERNEL(LANES, wigner_factors)
{
    const long item = get_group_id(0);
    const int m = order[item];
    factors += item * 4 * (n_term + 1);
    SPREAD(l, m, n_term)
        PUT(factors, l) = (real4)(vrte_wigner_lower(m, 0, l), vrte_wigner_upper(m, 0, l),
                                  l >= 2 ? vrte_wigner_lower(m, 2, l) : 0.0, l >= 2 ? vrte_wigner_upper(m, 2, l) : 1.0);
    if (LANE == 0)
        PUT(factors, n_term) = (real4)(vrte_start_factor(m), vrte_polar_factor(m), 0.0, 0.0);
}

// The columns of P_l^m of an item. Pieces: `each` directions, items.
KERNEL(LANES, parity_columns)
{
    const long item = get_group_id(1);
    const int m = order[item], members = bits, stokes = popcount(bits), begin_i = each * get_group_id(0);
    __global const real* mu = directions;
    const int n_degree = albedo[material[item]] == 0.0 ? 0 : max(0, terms[material[item]] - m);
    const int few[2] = {columns_of_kind(m, members, 0), columns_of_kind(m, members, 1)};
    const int same = (n_degree + 1) / 2, other = n_degree / 2, columns_E = same * few[0] + other * few[1];
    const bool polar = members & 6;
    const int ld = phi_ld;
    factors += item * 4 * (n_term + 1);
    phi = OF_ITEM(phi);
    if (get_global_id(0) == 0) {
        counts[2 * item] = columns_E;
        counts[2 * item + 1] = other * few[0] + same * few[1];
    }
    SPREAD(i, begin_i, min(n_all, begin_i + each)) {
        const int first = i < n_node ? 0 : i < n_node + n_out ? n_node : n_node + n_out;
        const int last = i < n_node ? n_node : i < n_node + n_out ? n_node + n_out : n_all;
        const int begin = i < n_node ? 0
                                     : next_strip(stokes * n_node) + (i < n_node + n_out ? 0 : next_strip(stokes * n_out));
        const int row = begin + stokes * (i - first), filled = begin + stokes * (last - first);
        const int blank = i == last - 1 ? next_strip(filled) : filled;
        const real scale = i < n_node ? sqrt(weights[i] / mu[i]) : 1.0;
        const real4 starts = AT(factors, n_term);
        real zero = vrte_wigner_start(m, mu[i], starts.x), zero_before = 0.0;       // d^l_{m,0} at l and at l - 1
        real plus = 0.0, plus_before = 0.0, minus = 0.0, minus_before = 0.0;        // d^l_{m,2} and d^l_{m,-2}
        __global real* even = phi;
        __global real* odd = phi + columns_E * (long)ld;
        for (int l = m; l < m + n_degree; l++) {
            if (l == max(m, 2))
                vrte_polar_start(m, mu[i], starts.y, &plus, &minus);
            const real p = scale * zero, r = scale * 0.5 * (plus + minus), t = scale * 0.5 * (plus - minus);
            for (int kind = 0; kind < 2; kind++) {
                const bool is_even = kind == ((l - m) & 1), left = has_first(m, members, kind);
                __global real* to = is_even ? even : odd;
                if (left)
                    put_members(to + row, members, kind ? (real4)(0.0, -t, r, 0.0) : (real4)(p, 0.0, 0.0, 0.0));
                if (few[kind] > left)
                    put_members(to + left * (long)ld + row, members,
                                kind ? (real4)(0.0, 0.0, 0.0, p) : (real4)(0.0, r, -t, 0.0));
                for (int k = filled; k < blank; k++)
                    for (int column = 0; column < few[kind]; column++)
                        to[column * (long)ld + k] = 0.0;
                even += is_even ? few[kind] * (long)ld : 0;
                odd += is_even ? 0 : few[kind] * (long)ld;
            }
            const real4 f = AT(factors, l);
            const real zero_now = zero, plus_now = plus, minus_now = minus;
            zero = l == 0 ? mu[i] : vrte_wigner_next(m, 0, l, mu[i], f.x, f.y, zero, zero_before);
            zero_before = zero_now;
            if (polar && l >= 2) {
                plus = vrte_wigner_next(m, 2, l, mu[i], f.z, f.w, plus, plus_before);
                minus = vrte_wigner_next(m, -2, l, mu[i], f.z, f.w, minus, minus_before);
                plus_before = plus_now;
                minus_before = minus_now;
            }
        }
    }
}

// psi = factor phi B^T on each `apart`-th real4 of first .. last - 1 of each column, B_l of (1:9) cut to the columns that there are, E's
// (odd = 0) or F's of the degrees begin .. end - 1, phi and psi being those of the degree m on; V's column of phi counts
// v_sign times.
void multiply_by_coefficients(int m, int begin, int end, int members, int odd, real factor, real v_sign,
                              __global const real* restrict coefficients, int first, int last, int apart,
                              __global const real* restrict phi, int ld, __global real* restrict psi, int psi_ld)
{
    const int before = (begin - m + 1) / 2 * columns_of_kind(m, members, odd)
        + (begin - m) / 2 * columns_of_kind(m, members, !odd);
    phi += before * (long)ld;
    psi += before * (long)psi_ld;
    for (int l = begin; l < end; l++) {
        __global const real* c = coefficients + 6 * l;
        const int kind = ((l - m) & 1) != odd, few = columns_of_kind(m, members, kind);
        if (few == 2) {
            const real b00 = factor * (kind ? c[2] : c[0]), b01 = factor * (kind ? -v_sign * c[5] : -c[4]);
            const real b10 = factor * (kind ? c[5] : -c[4]), b11 = factor * (kind ? v_sign * c[3] : c[1]);
            for (int i = first; i < last; i += apart) {
                const real4 x = AT(phi, i), y = AT(phi + ld, i);
                PUT(psi, i) = b00 * x + b01 * y;
                PUT(psi + psi_ld, i) = b10 * x + b11 * y;
            }
        } else if (few == 1) {
            const bool left = has_first(m, members, kind);
            const real b = factor * (kind ? (left ? c[2] : v_sign * c[3]) : (left ? c[0] : c[1]));
            for (int i = first; i < last; i += apart)
                PUT(psi, i) = b * AT(phi, i);
        }
        phi += few * (long)ld;
        psi += few * (long)psi_ld;
    }
}

// psi = albedo phi B^T. Pieces: `each` degrees, items.
KERNEL(LANES, times_coefficients)
{
    const long item = get_group_id(1);
    const int m = order[item], begin = m + each * (int)get_group_id(0), end = min(terms[material[item]], begin + each);
    const real factor = albedo[material[item]];
    if (factor == 0.0)
        return;
    for (int odd = 0; odd < 2; odd++) {
        const long column = first_column(counts, item, odd);
        multiply_by_coefficients(m, begin, end, bits, odd, odd ? odd_sign * factor : factor, v_sign,
                                 coefficients + material[item] * (long)6 * n_term, LANE, 2 * n_strip, LANES,
                                 OF_ITEM(phi) + column * phi_ld, phi_ld, OF_ITEM(psi) + column * psi_ld, psi_ld);
    }
}

// The diagonals 1/mu of E and F. Pieces: items.
KERNEL(LANES, add_rates)
{
    const long item = get_group_id(0);
    SPREAD(i, 0, n) {
        OF_ITEM(E)[(long)i * E_ld + i] += 1.0 / directions[i / stokes];
        OF_ITEM(F)[(long)i * F_ld + i] += 1.0 / directions[i / stokes];
    }
}
