# What multiple scattering can do at most, order by order, before anything is solved.

cdef struct Bounding:
    bint polar
    int n_term, n_layer, n_all, n_node, n_out, n_stack
    given_ints terms
    given coefficients, albedo, directions
    doubles strength, bounds


def order_bounds(crew, *, const double[:, :, ::1] coefficients, const int[::1] terms, const double[::1] albedo,
                 const double[::1] directions, int n_node, int n_out, double[:, ::1] strength, double[::1] bounds,
                 int slab_stacks=1):
    """What multiple scattering can do, order by order, before anything is solved.

    coefficients (layer, term, 6); directions: n_node nodes, then n_out outgoing, then incident cosines. strength
    (layer, order): the norm q of one scattering, the largest omega |B_l|/(2 l + 1) of the degrees l >= m; bounds
    (order,): what all light scattered at least twice adds, times 1 - q, to the radiance of one order for a unit beam:
    with the norm of L2 over depth and direction, u v sqrt(mu0/mu)/(16 pi), where u and v are the norms of A^m's row to
    an outgoing direction and of its column from an incident one. Of several `slab_stacks` with as many layers each, all
    these lie one behind another.
    """
    cdef Bounding task = Bounding(
        not scatters_intensity_alone(coefficients), <int>coefficients.shape[1],
        <int>coefficients.shape[0] // slab_stacks, <int>directions.shape[0], n_node, n_out, slab_stacks,
        &terms[0], &coefficients[0, 0, 0], &albedo[0], &directions[0], &strength[0, 0], &bounds[0])
    run_items(crew, order_bound, &task, task.n_term, (4 * task.n_all + 1) * task.n_term + task.n_all, 0, NULL)


cdef bint scatters_intensity_alone(const double[:, :, ::1] coefficients) noexcept nogil:
    cdef Py_ssize_t layer, l, k
    for layer in range(coefficients.shape[0]):
        for l in range(coefficients.shape[1]):
            for k in range(1, 6):
                if coefficients[layer, l, k] != 0.0:
                    return False
    return True


cdef inline double norm_of_coefficients(given c) noexcept nogil:
    """Of both 2 x 2 blocks of B_l, the larger norm, or a little more."""
    cdef double first = 0.5 * fabs(c[0] + c[1]) + hypot(0.5 * (c[0] - c[1]), c[4])
    return max(first, max(fabs(c[2]), fabs(c[3])) + fabs(c[5]))


cdef int order_bound(const void* task, int m, Workspace desk) noexcept nogil:
    cdef const Bounding* b = <const Bounding*>task
    cdef int n_term = b.n_term, n_all = b.n_all, n_node = b.n_node, n_out = b.n_out
    cdef given directions = b.directions, albedo = b.albedo
    cdef doubles prt = desk.work
    cdef doubles norms = prt + <size_t>3 * n_all * n_term      # (l, direction): |P_l^m|
    cdef doubles u = norms + <size_t>n_all * n_term
    cdef doubles size = u + n_all
    cdef int l, i, layer, slab_stack
    cdef double worst_u, worst_v, factor
    cdef given p
    cdef doubles norm, q, bound
    spherical(m, n_term, b.polar, directions, n_all, prt)
    for l in range(m, n_term):
        p = prt + <size_t>3 * l * n_all
        norm = norms + <size_t>l * n_all
        if b.polar:
            for i in range(n_all):
                norm[i] = max(fabs(p[i]), fabs(p[n_all + i]) + fabs(p[2 * n_all + i]))
        else:
            for i in range(n_all):
                norm[i] = fabs(p[i])
    for layer in range(b.n_stack * b.n_layer):
        slab_stack = layer // b.n_layer
        bound = b.bounds + <size_t>slab_stack * n_term + m
        if layer % b.n_layer == 0:
            bound[0] = 0.0
        worst_u = worst_v = 0.0
        q = b.strength + <size_t>layer * n_term + m
        q[0] = 0.0
        set_zero(n_all, u)
        for l in range(m, b.terms[layer]):
            norm = norms + <size_t>l * n_all
            size[l] = albedo[layer] * norm_of_coefficients(b.coefficients + (<size_t>layer * n_term + l) * 6)
            q[0] = max(q[0], size[l] / (2.0 * l + 1.0))
            factor = 2.0 / (2.0 * l + 1.0) * size[l] * size[l]
            for i in range(n_all):
                u[i] += factor * norm[i] * norm[i]
        for i in range(n_node, n_node + n_out):      # grazing light leaves the uppermost sheet: no more than at 0.01
            worst_u = max(worst_u, u[i] / max(directions[i], 0.01))
        for i in range(n_node + n_out, n_all):
            worst_v = max(worst_v, u[i] * directions[i])
        bound[0] = max(bound[0], sqrt(worst_u * worst_v) / (16.0 * PI))
    return 0


def bounds_at(*, const double[:, ::1] strength, const double[:, ::1] bounds, const double[:, ::1] depth,
              const double[::1] decays):
    """What multiple scattering of each order of each scene adds at most at each depth, (scene, order, n_tau).

    strength, bounds (scene, order); depth (scene, n_tau). An order decays with depth at least as fast as
    e^(-kappa tau), kappa < 1 - q: its bound there is bound e^(-kappa tau)/((1 - kappa) (1 - q/(1 - kappa))), the least
    of it for kappa = decays (1 - q).
    """
    cdef int n_scene = <int>strength.shape[0], n_order = <int>strength.shape[1], n_tau = <int>depth.shape[1]
    cdef int scene, m, t, d
    cdef double[:, :, ::1] out = np.zeros((n_scene, n_order, n_tau))
    cdef double q, kappa, rest, least
    for scene in range(n_scene):
        for m in range(n_order):
            if not bounds[scene, m] > 0.0:
                continue
            q = min(strength[scene, m], 1.0)
            for t in range(n_tau):
                least = INFINITY
                for d in range(<int>decays.shape[0]):
                    kappa = decays[d] * (1.0 - q)
                    rest = 1.0 - kappa - q
                    if rest > 0.0:
                        least = min(least, exp(-kappa * depth[scene, t]) / rest)
                out[scene, m, t] = bounds[scene, m] * least
    return np.asarray(out)


def orders_that_matter(*, const double[:, :, :, ::1] bounds, const double[:, :, ::1] brightest, double allowed,
                       double largest):
    """How many orders of each scene: all others together add, at every depth, no more than `allowed` times the light
    there; at least 1, (scene,).

    bounds (scene, order, n_tau, n_in or 1), of which `largest` counts at most; brightest (scene, n_tau, n_in).
    """
    cdef int n_scene = <int>bounds.shape[0], n_order = <int>bounds.shape[1], n_tau = <int>bounds.shape[2]
    cdef int n_in = <int>brightest.shape[2], scene, t, i, m
    cdef bint apiece = bounds.shape[3] > 1
    cdef int[::1] out = np.ones(n_scene, np.int32)
    cdef double tail
    for scene in range(n_scene):
        for t in range(n_tau):
            for i in range(n_in):
                tail = 0.0
                for m in range(n_order - 1, out[scene] - 1, -1):
                    tail += min(bounds[scene, m, t, i if apiece else 0], largest)
                    if not 2.0 * tail <= allowed * brightest[scene, t, i]:
                        out[scene] = m + 1
                        break
    return np.asarray(out)
