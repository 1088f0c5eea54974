/* Photons, one by one: a direction w, an axis l across it that their Stokes parameters refer to (r = l x w), and the
   Mueller matrix m from the incident light to theirs, incident columns last. Chances are those of unpolarized incident
   light: its I stays as it is. Everything is a vector in space, z up; no meridian plane before light is counted. */

#include "surfaces.h"

typedef unsigned long long vrte_bits;
typedef struct {
    double w[3], l[3], m[4][4], depth, path;
    int layer, is_beam;
    vrte_bits chance;
} vrte_photon;

enum { VRTE_OPEN, VRTE_SMOOTH, VRTE_ROUGH, VRTE_LAMBERTIAN, VRTE_ROUGH_BASE, VRTE_PARKING, VRTE_DEEP };
enum { VRTE_GOES_ON, VRTE_ENDS, VRTE_PARKS, VRTE_PARKED = 24 };   /* doubles of a parked photon */
#define VRTE_SURVIVAL 0.5       /* the least chance to be scattered rather than absorbed; weights make up for it */
#define VRTE_STEEPEST 6.0       /* slopes over alpha of Beckmann's facets that are never met */
#define VRTE_FARTHEST 60.0      /* optical thickness to a view beyond which nothing is counted */
#define VRTE_TWO_PI 6.283185307179586477

static inline vrte_bits photon_mix(vrte_bits z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
}

/* Evenly between 0 and 1, neither included: SplitMix64, a hash of a counter (Steele, Lea and Flood 2014). */
static inline double photon_chance(vrte_photon* p) {
    p->chance += 0x9e3779b97f4a7c15ULL;
    return ((double)(photon_mix(p->chance) >> 11) + 0.5) * 1.1102230246251565e-16;
}

static inline void photon_cross(const double* a, const double* b, double* c) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static inline double photon_dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Cosine and sine of an even angle. */
static inline void photon_any_angle(vrte_photon* p, double* c, double* s) {
    double a, b, square;
    do {
        a = 2.0 * photon_chance(p) - 1.0;
        b = 2.0 * photon_chance(p) - 1.0;
        square = a * a + b * b;
    } while (square > 1.0 || square < 1e-30);
    *c = (a - b) * (a + b) / square;
    *s = 2.0 * a * b / square;
}

/* Refers Q and U to the axis cos l + sin r. */
static inline void photon_turn(double (*m)[4], double c, double s) {
    double c2 = (c - s) * (c + s), s2 = 2.0 * c * s;
    for (int j = 0; j < 4; j++) {
        double q = m[1][j], u = m[2][j];
        m[1][j] = c2 * q + s2 * u;
        m[2][j] = c2 * u - s2 * q;
    }
}

static inline void photon_refer_to(const vrte_photon* p, double (*m)[4], const double* axis) {
    double r[3];
    photon_cross(p->l, p->w, r);
    photon_turn(m, photon_dot(axis, p->l), photon_dot(axis, r));
}

/* (I, Q) by [[a, b], [b, d]], (U, V) by [[re, im], [-im, e]], all times scale. */
static inline void photon_act(double (*m)[4], double a, double b, double d, double re, double im, double e,
                              double scale) {
    a *= scale, b *= scale, d *= scale, re *= scale, im *= scale, e *= scale;
    for (int j = 0; j < 4; j++) {
        double i = m[0][j], q = m[1][j], u = m[2][j], v = m[3][j];
        m[0][j] = a * i + b * q;
        m[1][j] = b * i + d * q;
        m[2][j] = re * u + im * v;
        m[3][j] = e * v - im * u;
    }
}

static inline void photon_scale(double (*m)[4], double factor) {
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            m[i][j] *= factor;
}

/* The direction of theta-hat, and the azimuth in degrees. */
static inline double photon_meridian(const double* w, double* theta) {
    double across = sqrt(w[0] * w[0] + w[1] * w[1]), c = 1.0, s = 0.0;
    if (across > 1e-14)
        c = w[0] / across, s = w[1] / across;
    theta[0] = w[2] * c;
    theta[1] = w[2] * s;
    theta[2] = -across;
    return atan2(s, c) * (360.0 / VRTE_TWO_PI);
}

static inline int photon_bin(int n, const double* edges, double x) {      /* of n edges; -1 outside */
    if (x < edges[0] || x > edges[n - 1])
        return -1;
    int k = 0;
    while (k < n - 2 && x >= edges[k + 1])
        k++;
    return k;
}

/* Keeps w and l of unit length and apart: rounding grows otherwise, by a factor at each scattering. */
static inline void photon_straighten(vrte_photon* p) {
    double longer = 1.5 - 0.5 * photon_dot(p->w, p->w), along, size;
    for (int k = 0; k < 3; k++)
        p->w[k] *= longer;
    along = photon_dot(p->w, p->l);
    size = 1.5 - 0.5 * photon_dot(p->l, p->l);
    for (int k = 0; k < 3; k++)
        p->l[k] = size * (p->l[k] - along * p->w[k]);
}

/* Counts a photon that goes through a place: 0 leaves at the top, 1 at the bottom, then levels. Its mirror image in the
   plane of incidence is as likely, and is what is counted of azimuths below 0. */
static void photon_count(const vrte_arrays* t, vrte_photon* p, int place) {
    double m[4][4], theta[3];
    size_t at = (size_t)place * 2 + (p->w[2] < 0.0);
    double phi = photon_meridian(p->w, theta);
    memcpy(m, p->m, sizeof m);
    photon_refer_to(p, m, theta);
    double* out;
    if (p->is_beam)
        out = t->beams + at * 16;
    else {
        int i = photon_bin(t->n_mu_edge, t->mu_edges, fabs(p->w[2]));
        int k = photon_bin(t->n_phi_edge, t->phi_edges, fabs(phi));
        if (i < 0 || k < 0)
            return;
        out = t->bins + (((at * (t->n_mu_edge - 1) + i) * (t->n_phi_edge - 1)) + k) * 16;
    }
    double image = phi < 0.0 && !p->is_beam ? -1.0 : 1.0;
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            out[4 * i + j] += (i < 2) == (j < 2) ? m[i][j] : image * m[i][j];
}

/* What a layer, or a surface behind all layers, keeps of a photon. */
static void photon_keep(const vrte_arrays* t, const vrte_photon* p, int keeper, double share) {
    double* kept = t->kept + (size_t)keeper * 4;
    for (int j = 0; j < 4; j++)
        kept[j] += share * p->m[0][j];
}

/* The entry of a table of chances, ascending from 0 to 1, that u is behind, and how far on to the next it is. */
static int photon_find(int n, const double* sums, double u, double* share) {
    int low = 0, high = n - 1;
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (sums[middle] <= u)
            low = middle;
        else
            high = middle;
    }
    *share = (u - sums[low]) / (sums[high] - sums[low]);
    return low;
}

/* Scatters light by elements F11, F22, F33, F44, F12, F34 in the plane of w and c l + sn r, at 1 - cosine = gap. */
static void photon_deflect(vrte_photon* p, const double* f, double gap, double c, double sn, double scale) {
    double cosine = 1.0 - gap, sine = sqrt(gap * (2.0 - gap)), across[3];
    photon_turn(p->m, c, sn);
    photon_act(p->m, f[0], f[4], f[1], f[2], f[5], f[3], scale);
    photon_cross(p->l, p->w, across);
    for (int k = 0; k < 3; k++) {
        double axis = c * p->l[k] + sn * across[k], w = p->w[k];
        p->w[k] = cosine * w + sine * axis;
        p->l[k] = cosine * axis - sine * w;
    }
    photon_straighten(p);
}

/* A particle scatters: the angle by F11, linear in its cosine between the entries of a table, then the azimuth by the
   polarization of the light itself. */
static void photon_scatter(const vrte_arrays* t, vrte_photon* p) {
    int table = t->table_of[p->layer], first = t->table_first[table], n = t->table_first[table + 1] - first;
    const double *sums = t->sums_to + first, *gaps = t->gaps + first;
    double u = photon_chance(p);
    int i = t->guide[first + (int)(u * n)];
    while (i < n - 2 && sums[i + 1] < u)
        i++;
    const double *low = t->elements + 6 * ((size_t)first + i), *high = low + 6;
    double r = (u - sums[i]) / (sums[i + 1] - sums[i]), both = low[0] + high[0];
    double s = r * both / (low[0] + sqrt(fmax(low[0] * low[0] + (high[0] - low[0]) * r * both, 0.0)));
    double f[6], gap = gaps[i] + s * (gaps[i + 1] - gaps[i]);
    for (int k = 0; k < 6; k++)
        f[k] = low[k] + s * (high[k] - low[k]);
    for (int k = 1; k < 6; k++)
        f[k] /= f[0];
    double c, sn, more, q = p->m[1][0] / p->m[0][0], v = p->m[2][0] / p->m[0][0];
    do {
        photon_any_angle(p, &c, &sn);
        more = 1.0 + f[4] * (q * (c - sn) * (c + sn) + v * 2.0 * c * sn);
    } while (f[4] != 0.0 && photon_chance(p) * (1.0 + fabs(f[4])) > more);
    f[0] = 1.0;
    photon_deflect(p, f, gap, c, sn, 1.0 / more);
}

/* A flat surface, relative index n + i k, at a cosine c: what it does to reflected light, a, b, re, im of photon_act;
   n c of what gets in where it is real, else 0. */
static double photon_fresnel(double n, double k, double c, double* reflected) {
    vrte_complex p, s, inside = vrte_fresnel(vrte_pair(n, k), c, &p, &s);
    double rp = p.x * p.x + p.y * p.y, rs = s.x * s.x + s.y * s.y;
    reflected[0] = 0.5 * (rp + rs);
    reflected[1] = 0.5 * (rp - rs);
    reflected[2] = p.x * s.x + p.y * s.y;
    reflected[3] = p.y * s.x - p.x * s.y;
    return inside.y == 0.0 ? inside.x : 0.0;
}

/* Refers light to the plane that it and the normal h make; the cosine of incidence, and s across that plane. */
static double photon_meet_plane(vrte_photon* p, const double* h, double* across) {
    double axis[3], size;
    photon_cross(p->w, h, across);
    size = sqrt(photon_dot(across, across));
    if (size < 1e-12)
        photon_cross(p->l, p->w, across);
    else
        for (int k = 0; k < 3; k++)
            across[k] /= size;
    photon_cross(p->w, across, axis);
    photon_refer_to(p, p->m, axis);
    return fabs(photon_dot(p->w, h));
}

static void photon_reflect(vrte_photon* p, const double* h, const double* across) {
    double twice = 2.0 * photon_dot(p->w, h);
    for (int k = 0; k < 3; k++)
        p->w[k] -= twice * h[k];
    photon_cross(p->w, across, p->l);
    photon_straighten(p);
}

/* A flat surface with the normal h on the light's side: 1 it reflects, 0 it lets through, -1 it keeps the photon. */
static int photon_meet_flat(vrte_photon* p, const double* h, double n, double k, int is_closed) {
    double across[3], reflected[4], c = photon_meet_plane(p, h, across);
    double inside = photon_fresnel(n, k, c, reflected), a = reflected[0], b = reflected[1];
    double share = a + b * p->m[1][0] / p->m[0][0];
    if ((inside == 0.0 && !is_closed && k == 0.0) || photon_chance(p) < share) {
        photon_act(p->m, a, b, a, reflected[2], reflected[3], reflected[2], 1.0 / share);
        photon_reflect(p, h, across);
        return 1;
    }
    if (is_closed || k != 0.0)
        return -1;
    double mixed = inside / c * 4.0 * c * c * n / ((n * n * c + inside) * (c + inside));
    photon_act(p->m, 1.0 - a, -b, 1.0 - a, mixed, 0.0, mixed, 1.0 / (1.0 - share));
    double down = (c - inside) / n, size = 0.0;
    for (int j = 0; j < 3; j++) {
        p->w[j] = p->w[j] / n + down * h[j];
        size += p->w[j] * p->w[j];
    }
    for (int j = 0; j < 3; j++)
        p->w[j] /= sqrt(size);
    photon_cross(p->w, across, p->l);
    return 0;
}

/* The normal h of a facet as the photon sees them: by the area that each turns to it. GGX: Heitz, JCGT 7 (2018). */
static void photon_meet_facets(vrte_photon* p, double alpha, int is_ggx, double* h) {
    double v[3] = {-p->w[0], -p->w[1], fabs(p->w[2])}, c, s, size;
    if (is_ggx) {
        double x = alpha * v[0], y = alpha * v[1], z = v[2], a, b, r = sqrt(photon_chance(p)), across, rest;
        size = sqrt(x * x + y * y + z * z);
        x /= size, y /= size, z /= size;
        across = sqrt(x * x + y * y);
        photon_any_angle(p, &c, &s);
        double ex = across > 1e-12 ? -y / across : 1.0, ey = across > 1e-12 ? x / across : 0.0;
        a = r * c;
        b = 0.5 * (1.0 - z) * sqrt(1.0 - a * a) + 0.5 * (1.0 + z) * r * s;
        rest = sqrt(fmax(1.0 - a * a - b * b, 0.0));
        h[0] = alpha * (a * ex - b * z * ey + rest * x);
        h[1] = alpha * (a * ey + b * z * ex + rest * y);
        h[2] = fmax(b * across + rest * z, 1e-12);
    } else {
        double across = sqrt(v[0] * v[0] + v[1] * v[1]), radius, seen;
        do {
            photon_any_angle(p, &c, &s);
            radius = alpha * sqrt(-log(photon_chance(p)));
            h[0] = -radius * c, h[1] = -radius * s, h[2] = 1.0;
            seen = v[2] + h[0] * v[0] + h[1] * v[1];
        } while (seen < photon_chance(p) * (v[2] + VRTE_STEEPEST * alpha * across));
    }
    size = sqrt(photon_dot(h, h));
    for (int k = 0; k < 3; k++)
        h[k] /= size;
    if (p->w[2] > 0.0)
        h[2] = -h[2];
}

/* Unpolarized light or light polarized along the meridian, Q = ratio I, in any azimuth. */
static void photon_send(vrte_photon* p, double mu, double ratio) {
    double c, s, sine = sqrt((1.0 - mu) * (1.0 + mu));
    photon_any_angle(p, &c, &s);
    p->w[0] = sine * c, p->w[1] = sine * s, p->w[2] = mu;
    photon_meridian(p->w, p->l);
    for (int j = 0; j < 4; j++) {
        p->m[1][j] = ratio * p->m[0][j];
        p->m[2][j] = p->m[3][j] = 0.0;
    }
    p->is_beam = 0;
}

/* What facets hide is given back: on the side it came from by a chance, else on the other, along mu by l(mu) mu. */
static int photon_give_back(const vrte_arrays* t, vrte_photon* p, int k, int from_below) {
    const double* of = t->surface_numbers + 8 * k;
    double u = photon_chance(p), same = of[6 + from_below];
    int below = from_below;
    if (u >= same) {
        if (t->surface_kind[k] == VRTE_ROUGH_BASE)
            return VRTE_ENDS;
        below = !below;
    }
    const double* row = t->lost + ((size_t)2 * k + below) * 3 * t->n_lost;
    const double *mu = row, *sums = row + t->n_lost, *ratio = sums + t->n_lost;
    int low = photon_find(t->n_lost, sums, photon_chance(p), &u), high = low + 1;
    double x = mu[low] + u * (mu[high] - mu[low]);
    photon_send(p, below ? -x : x, ratio[low] + u * (ratio[high] - ratio[low]));
    return VRTE_GOES_ON;
}

/* What a rough surface does; facets that hide light give it back, or it is lost. */
static int photon_meet_rough(const vrte_arrays* t, vrte_photon* p, int k, double n) {
    const double* of = t->surface_numbers + 8 * k;
    int is_ggx = of[3] != 0.0, shadowing = of[4] != 0.0, conserving = of[5] != 0.0, from_below = p->w[2] > 0.0;
    int is_closed = t->surface_kind[k] == VRTE_ROUGH_BASE, went = 1;
    double h[3], w[3], seen = vrte_smith(of[2], is_ggx, fabs(p->w[2])), kept = 1.0;
    photon_meet_facets(p, of[2], is_ggx, h);
    p->is_beam = 0;
    if (is_closed) {
        double twice = 2.0 * photon_dot(p->w, h);
        for (int j = 0; j < 3; j++)
            w[j] = p->w[j] - twice * h[j];
    } else {
        went = photon_meet_flat(p, h, n, 0.0, 0);
        memcpy(w, p->w, sizeof w);
    }
    if ((w[2] > 0.0) == (went ? from_below : !from_below) || w[2] == 0.0)
        kept = 0.0;
    else if (shadowing) {
        kept = vrte_smith(of[2], is_ggx, fabs(w[2]));
        if (!went && conserving)
            kept = fmin(kept, seen) / seen;
    }
    if (kept == 1.0 || photon_chance(p) < kept) {
        if (!shadowing)
            photon_scale(p->m, 1.0 / seen);
        return is_closed && photon_meet_flat(p, h, of[0], of[1], 1) < 0 ? VRTE_ENDS : VRTE_GOES_ON;
    }
    return conserving ? photon_give_back(t, p, k, from_below) : VRTE_ENDS;
}

/* What a flake with the normal h does to light, referred to their plane: a, b, re, im of photon_act, of light that is
   reflected and then of light that is let through. */
static void photon_meet_mirror(const vrte_arrays* t, vrte_photon* p, const double* h, double* across, double* met) {
    const double* act = t->mirrors + (size_t)8 * t->n_cosine * t->flake_of[p->layer];
    double c = photon_meet_plane(p, h, across) * (t->n_cosine - 1);
    int i = c < t->n_cosine - 2 ? (int)c : t->n_cosine - 2;
    for (int k = 0; k < 8; k++)
        met[k] = act[8 * i + k] + (c - i) * (act[8 * i + 8 + k] - act[8 * i + k]);
}

enum { VRTE_BY_PARTICLE, VRTE_BY_FLAKE, VRTE_BY_BASE };

/* Optical thickness along a view from where a photon is to the depth of that view, infinite where it leads away. */
static double photon_way_out(const vrte_arrays* t, const vrte_photon* p, int v) {
    int k = p->layer, to = t->view_layer[v], up = t->views[6 * v + 2] > 0.0;
    double depth = p->depth, way = 0.0;
    if (up ? k < to : k > to)
        return INFINITY;
    for (; k != to; k += up ? -1 : 1) {
        way += t->view_rate[(size_t)k * t->n_view + v] * (up ? depth : t->extent[k] - depth);
        depth = up ? t->extent[k - 1] : 0.0;
    }
    depth = up ? depth - t->view_depth[v] : t->view_depth[v] - depth;
    return depth < 0.0 ? INFINITY : way + t->view_rate[(size_t)k * t->n_view + v] * depth;
}

/* Scatters a photon by a particle into the direction w, times scale. */
static void photon_scatter_to(const vrte_arrays* t, vrte_photon* p, const double* w, double scale) {
    int table = t->table_of[p->layer], first = t->table_first[table], n = t->table_first[table + 1] - first;
    double across[3], f[6], gap = 0.0, c, sn, sine;
    photon_cross(p->l, p->w, across);
    c = photon_dot(w, p->l), sn = photon_dot(w, across), sine = hypot(c, sn);
    for (int k = 0; k < 3; k++)
        gap += 0.5 * (w[k] - p->w[k]) * (w[k] - p->w[k]);
    gap = fmin(gap, 2.0);
    double angle = atan2(sine, 1.0 - gap) / (0.5 * VRTE_TWO_PI) * (n - 1);
    int i = angle < n - 2 ? (int)angle : n - 2;
    const double *low = t->elements + 6 * ((size_t)first + i), *gaps = t->gaps + first + i;
    double s = (gap - gaps[0]) / (gaps[1] - gaps[0]);
    for (int k = 0; k < 6; k++)
        f[k] = low[k] + s * (low[6 + k] - low[k]);
    photon_deflect(p, f, gap, sine > 0.0 ? c / sine : 1.0, sine > 0.0 ? sn / sine : 0.0, scale);
}

/* Reflects a photon by flakes into the direction w: by the density of the normals that do so, over 4. */
static void photon_mirror_to(const vrte_arrays* t, vrte_photon* p, const double* w) {
    const double* tilts = t->tilts + (size_t)3 * t->n_tilt * t->flake_of[p->layer];
    double h[3], across[3], met[8], size;
    for (int k = 0; k < 3; k++)
        h[k] = w[k] - p->w[k];
    size = fmax(sqrt(photon_dot(h, h)), 1e-300);
    for (int k = 0; k < 3; k++)
        h[k] /= size;
    double at = atan2(hypot(h[0], h[1]), fabs(h[2])) / acos(tilts[t->n_tilt - 1]) * (t->n_tilt - 1);
    if (!(at < t->n_tilt - 1)) {
        photon_scale(p->m, 0.0);
        return;
    }
    int i = (int)at;
    const double* density = tilts + 2 * t->n_tilt + i;
    photon_meet_mirror(t, p, h, across, met);
    photon_act(p->m, met[0], met[1], met[0], met[2], met[3], met[2],
               0.25 * (density[0] + (at - i) * (density[1] - density[0])));
    photon_reflect(p, h, across);
}

/* Next-event estimates: what light that is scattered here sends along every view and out to its depth. */
static void photon_estimate(const vrte_arrays* t, const vrte_photon* from, int by) {
    for (int v = 0; v < t->n_view; v++) {
        const double *w = t->views + 6 * v, *theta = w + 3;
        double way = photon_way_out(t, from, v);
        vrte_photon p = *from;
        if (way > VRTE_FARTHEST || (by == VRTE_BY_BASE && w[2] < 0.0))
            continue;
        if (by == VRTE_BY_PARTICLE)
            photon_scatter_to(t, &p, w, t->albedo[p.layer] / (2.0 * VRTE_TWO_PI));
        else if (by == VRTE_BY_FLAKE)
            photon_mirror_to(t, &p, w);
        else {
            photon_scale(p.m, t->surface_numbers[8 * t->n_layer] * w[2] / (0.5 * VRTE_TWO_PI));
            memset(p.m[1], 0, 3 * sizeof p.m[1]);
        }
        if (by != VRTE_BY_BASE)
            photon_refer_to(&p, p.m, theta);
        double *out = t->viewed + (size_t)v * 16, passed = exp(-way) / fabs(w[2]);
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++)
                out[4 * i + j] += passed * p.m[i][j];
    }
}

/* What happens at the surface above layer k, or below the last; a photon that is kept is counted there. */
static int photon_meet_surface(const vrte_arrays* t, vrte_photon* p, int k) {
    const double* of = t->surface_numbers + 8 * k;
    int from_below = p->w[2] > 0.0, n_layer = t->n_layer, verdict = VRTE_GOES_ON;
    double n = from_below ? 1.0 / of[0] : of[0], h[3] = {0.0, 0.0, from_below ? -1.0 : 1.0};
    switch (t->surface_kind[k]) {
    case VRTE_SMOOTH:
        photon_meet_flat(p, h, n, 0.0, 0);
        break;
    case VRTE_ROUGH:
        verdict = photon_meet_rough(t, p, k, n);
        break;
    case VRTE_ROUGH_BASE:
        verdict = photon_meet_rough(t, p, k, of[0]);
        break;
    case VRTE_LAMBERTIAN:
        photon_estimate(t, p, VRTE_BY_BASE);
        if (photon_chance(p) < of[0])
            photon_send(p, sqrt(photon_chance(p)), 0.0);
        else
            verdict = VRTE_ENDS;
        break;
    case VRTE_PARKING:
        return VRTE_PARKS;
    case VRTE_DEEP:
        p->w[2] = -p->w[2];
        p->l[2] = -p->l[2];
        photon_act(p->m, 1.0, 0.0, 1.0, -1.0, 0.0, -1.0, 1.0);
    }
    if (verdict == VRTE_ENDS) {
        photon_keep(t, p, n_layer + k, 1.0);
        return verdict;
    }
    p->layer = p->w[2] > 0.0 ? k - 1 : k;
    if (p->layer < 0 || p->layer == n_layer) {
        t->spent[p->layer < 0 ? 2 : 3] += p->m[0][0];
        photon_count(t, p, p->layer < 0 ? 0 : 1);
        return VRTE_ENDS;
    }
    p->depth = p->w[2] > 0.0 ? t->extent[p->layer] : 0.0;
    return VRTE_GOES_ON;
}

/* A flake, its normal by the density of tilts. It is met by the area that it turns to the light: if not, the photon
   goes on as it was. What a plate lets through goes straight on, and a beam is still one. */
static int photon_meet_flake(const vrte_arrays* t, vrte_photon* p) {
    const double* cosines = t->tilts + (size_t)3 * t->n_tilt * t->flake_of[p->layer];
    double u = photon_chance(p), s, c, h[3], across[3], met[8];
    int i = photon_find(t->n_tilt, cosines + t->n_tilt, u, &s);
    h[2] = cosines[i] + s * (cosines[i + 1] - cosines[i]);
    photon_any_angle(p, &c, &s);
    h[0] = sqrt((1.0 - h[2]) * (1.0 + h[2]));
    h[1] = s * h[0];
    h[0] *= c;
    c = photon_dot(p->w, h);
    if (photon_chance(p) >= fabs(c))
        return VRTE_GOES_ON;
    t->spent[0] += 1.0;
    photon_meet_mirror(t, p, h, across, met);
    double ratio = p->m[1][0] / p->m[0][0], share = met[0] + met[1] * ratio, passed = met[4] + met[5] * ratio;
    u = share < 1.0 - 1e-14 ? photon_chance(p) : 0.0;
    if (u >= share && passed > 0.0 && (u < share + passed || share + passed > 1.0 - 1e-12)) {
        photon_act(p->m, met[4], met[5], met[4], met[6], met[7], met[6], 1.0 / passed);
        photon_cross(p->w, across, p->l);
        return VRTE_GOES_ON;
    }
    p->is_beam = 0;
    if (u >= share) {
        photon_keep(t, p, p->layer, 1.0);
        return VRTE_ENDS;
    }
    photon_act(p->m, met[0], met[1], met[0], met[2], met[3], met[2], 1.0 / share);
    photon_reflect(p, h, across);
    return VRTE_GOES_ON;
}

/* A collision: with a flake or a particle, by their extinctions for light along the normal to all flakes. */
static int photon_collide(const vrte_arrays* t, vrte_photon* p) {
    int k = p->layer;
    double albedo = t->albedo[k], survival = fmax(albedo, VRTE_SURVIVAL);
    if (t->flake_share[k] > 0.0 && photon_chance(p) < t->flake_share[k]) {
        photon_estimate(t, p, VRTE_BY_FLAKE);
        return photon_meet_flake(t, p);
    }
    if (albedo > 0.0)
        photon_estimate(t, p, VRTE_BY_PARTICLE);
    t->spent[0] += 1.0;
    p->is_beam = 0;
    if (albedo == 0.0 || photon_chance(p) >= survival) {
        photon_keep(t, p, k, albedo == 0.0 ? 1.0 : (1.0 - albedo) / (1.0 - survival));
        return VRTE_ENDS;
    }
    if (survival > albedo)
        photon_scale(p->m, albedo / survival);
    photon_scatter(t, p);
    return VRTE_GOES_ON;
}

/* Counts a way through a layer at the levels on it. */
static void photon_pass_levels(const vrte_arrays* t, vrte_photon* p, double to) {
    double low = fmin(p->depth, to), high = fmax(p->depth, to);
    for (int k = 2; k < t->n_counted; k++)
        if (t->level_layer[k] == p->layer && t->level_depth[k] >= low && t->level_depth[k] <= high)
            photon_count(t, p, k);
}

/* Follows a photon to its end, or to where it is parked. The first collision of a beam is at least as likely in each
   layer as `forced`, weights making up for it. */
static int photon_follow(const vrte_arrays* t, vrte_photon* p) {
    for (double event = 0.0; event < t->most_events; event += 1.0) {
        double mu = p->w[2], there = mu > 0.0 ? 0.0 : t->extent[p->layer], to = there;
        double way = fabs((there - p->depth) / mu);
        int collides;
        if (mu == 0.0 || isinf(there))
            way = INFINITY;
        if (p->is_beam && t->forced > 0.0) {
            double share = -expm1(-way), chance = fmax(share, t->forced);
            collides = share > 0.0 && photon_chance(p) < chance;
            if (collides)
                p->path = -log1p(-photon_chance(p) * share);
            if (chance > share && share > 0.0)
                photon_scale(p->m, collides ? share / chance : (1.0 - share) / (1.0 - chance));
        } else
            collides = p->path < way;
        if (collides)
            to = p->depth - p->path * mu;
        photon_pass_levels(t, p, to);
        p->depth = to;
        if (!collides) {
            if (!p->is_beam || t->forced == 0.0)
                p->path -= way;
            int was_beam = p->is_beam, verdict = photon_meet_surface(t, p, mu > 0.0 ? p->layer : p->layer + 1);
            if (verdict != VRTE_GOES_ON)
                return verdict;
            if (was_beam && !p->is_beam)
                p->path = -log(photon_chance(p));
            continue;
        }
        if (photon_collide(t, p) == VRTE_ENDS)
            return VRTE_ENDS;
        p->path = -log(photon_chance(p));
    }
    t->spent[1] += p->m[0][0];
    return VRTE_ENDS;
}

/* Follows the photons of a batch, from the first surface on, or from where they were parked. */
static void photon_follow_batch(const vrte_arrays* t, int batch, const int* stop) {
    int parked = 0, starts = t->n_start > 0 ? t->start_count[0] : t->photons_each;
    for (int i = 0; i < starts && !*stop; i++) {
        vrte_photon p;
        double* row;
        memset(&p, 0, sizeof p);
        if (t->n_start > 0) {
            row = t->starts + (size_t)i * VRTE_PARKED;
            memcpy(p.w, row, sizeof p.w);
            memcpy(p.l, row + 3, sizeof p.l);
            memcpy(p.m, row + 6, sizeof p.m);
            memcpy(&p.chance, row + 22, sizeof p.chance);
            p.is_beam = row[23] != 0.0;
            p.layer = t->n_layer - 1;
            p.depth = t->extent[p.layer];
            p.path = -log(photon_chance(&p));
        } else {
            vrte_bits number = (vrte_bits)(t->first_batch + batch) * (vrte_bits)t->photons_each + (vrte_bits)i;
            vrte_bits seed = (vrte_bits)(unsigned)t->key[0] | (vrte_bits)(unsigned)t->key[1] << 32;
            p.chance = photon_mix(photon_mix(seed + 0x9e3779b97f4a7c15ULL) + number * 0xd1342543de82ef95ULL);
            p.w[0] = sqrt((1.0 - t->mu_beam) * (1.0 + t->mu_beam)), p.w[2] = -t->mu_beam;
            p.l[0] = p.w[2], p.l[2] = -p.w[0];
            for (int j = 0; j < 4; j++)
                p.m[j][j] = 1.0;
            p.is_beam = 1;
            p.layer = -1;
            p.path = -log(photon_chance(&p));
            if (photon_meet_surface(t, &p, 0) == VRTE_ENDS)
                continue;
        }
        if (photon_follow(t, &p) == VRTE_PARKS) {
            row = t->parked + (size_t)(parked++) * VRTE_PARKED;
            memcpy(row, p.w, sizeof p.w);
            memcpy(row + 3, p.l, sizeof p.l);
            memcpy(row + 6, p.m, sizeof p.m);
            memcpy(row + 22, &p.chance, sizeof p.chance);
            row[23] = p.is_beam;
        }
    }
    if (t->n_parked > 0)
        t->parked_count[0] = parked;
}
