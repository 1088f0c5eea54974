// Between a program in doubles and one in floats, whose memory is the same.

// R in doubles from floats. Pieces: columns, items.
SHARED
__kernel void widen(__global const float* restrict from, STACK(R), INTS items)
{
    const long item = items[get_group_id(1)], column = get_group_id(0);
    from += item * R_stride + column * R_ld;
    R = OF_ITEM(R) + column * R_ld;
    SPREAD(i, 0, R_ld)
        R[i] = from[i];
}

// r = (X - R)/gap in floats, zeros behind the rows. Pieces: columns, items.
SHARED
__kernel void narrow_missing(int rows, IN row_mu, IN signed_mu, IN gap, STACK(Y), STACK(R), __global float* restrict r,
                             INTS items)
{
    const long item = items[get_group_id(1)], column = get_group_id(0);
    const real scale = gap[item] > 0.0 ? 1.0 / gap[item] : 0.0;
    r += item * R_stride + column * R_ld;
    Y = OF_ITEM(Y) + column * Y_ld;
    R = OF_ITEM(R) + column * R_ld;
    SPREAD(i, 0, R_ld)
        r[i] = i < rows ? scale * (Y[i] * share_of(row_mu[i], signed_mu[column]) - R[i]) : 0.0;
}

// R += gap d, d in floats. Pieces: columns, items.
SHARED
__kernel void add_correction(int rows, IN gap, __global const float* restrict d, STACK(R), INTS items)
{
    const long item = items[get_group_id(1)], column = get_group_id(0);
    d += item * R_stride + column * R_ld;
    R = OF_ITEM(R) + column * R_ld;
    SPREAD(i, 0, rows)
        R[i] += gap[item] * d[i];
}
