# What multiple scattering can do at most, order by order, before anything is solved.

cdef Job order_bounds_job(Arrays* t) noexcept nogil:
    cdef size_t i
    t.polar = False
    for i in range(<size_t>6 * t.n_layers * t.n_term):
        if i % 6 > 0 and t.coefficients[i] != 0.0:
            t.polar = True
            break
    return Job(t.n_term, (4 * <size_t>t.n_all + 1) * t.n_term + t.n_all, 0)


cdef extern from "core/kernels/in_c.h":
    double vrte_norm_of_degree(double a1, double a2, double a3, double a4, double b1, double b2) noexcept nogil


cdef inline double norm_of_coefficients(given c) noexcept nogil:
    """The norm of B_l, or a little more."""
    return vrte_norm_of_degree(c[0], c[1], c[2], c[3], c[4], c[5])


cdef void add_at_depths(const Arrays* t, int scene, int m, double q) noexcept nogil:
    """The bound of an order of a scene at its depths. It decays at least as fast as e^(-kappa tau), kappa < 1 - q: it
    is bound e^(-kappa tau)/((1 - kappa) (1 - q/(1 - kappa))), the least of it for kappa = rates (1 - q)."""
    cdef given depths = t.depths + <size_t>scene * t.n_level
    cdef size_t item = <size_t>scene * t.n_term + m
    cdef double kappa, rest, least
    cdef int k, d
    for k in range(t.n_level if t.bounds[item] > 0.0 else 0):
        least = INFINITY
        for d in range(t.n_rate):
            kappa = t.rates[d] * (1.0 - q)
            rest = 1.0 - kappa - q
            if rest > 0.0:
                least = min(least, exp(-kappa * depths[k]) / rest)
        t.added[item * t.n_level + k] = t.bounds[item] * least


cdef int order_bounds_one(const Arrays* b, int m, Workspace desk) noexcept nogil:
    cdef int n_term = b.n_term, n_all = b.n_all, n_node = b.n_node, n_out = b.n_out
    cdef given directions = b.directions, albedo = b.albedo
    cdef doubles prt = desk.work
    cdef doubles norms = prt + <size_t>3 * n_all * n_term      # (l, direction): |P_l^m|
    cdef doubles u = norms + <size_t>n_all * n_term
    cdef doubles size = u + n_all
    cdef int l, i, layer, slab_stack
    cdef double worst_u, worst_v, factor, largest
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
    for layer in range(b.slab_stacks * b.n_layer):
        slab_stack = layer // b.n_layer
        bound = b.bounds + <size_t>slab_stack * n_term + m
        if layer % b.n_layer == 0:
            bound[0] = largest = 0.0
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
        largest = max(largest, q[0])
        if layer % b.n_layer == b.n_layer - 1:
            add_at_depths(b, slab_stack, m, min(largest, 1.0))
    return 0


cdef int couplings_one(Arrays* t, int scene, Workspace desk) noexcept nogil:
    cdef ints present = t.present
    cdef given c
    cdef int layer, l, i
    for layer in range(scene * t.n_layer, (scene + 1) * t.n_layer):
        for l in range(t.n_term if t.albedo[layer] > 0.0 else 0):
            c = t.coefficients + (<size_t>layer * t.n_term + l) * 6
            for i in range(5):
                if c[1 + i] != 0.0:
                    present[l] |= 1 << i
    for l in range(t.n_term - 2, -1, -1):
        present[l] |= present[l + 1]
    return 0


cdef int orders_that_matter_one(Arrays* t, int scene, Workspace desk) noexcept nogil:
    cdef int n_order = t.n_order, k, i, m
    cdef double tail
    cdef given bounds
    t.counts[0] = 1
    for k in range(t.n_level):
        for i in range(t.n_in):
            tail = 0.0
            for m in range(n_order - 1, t.counts[0] - 1, -1):
                bounds = t.bounds + (<size_t>m * t.n_level + k) * t.n_beam
                tail += min(bounds[i if t.n_beam > 1 else 0], t.largest)
                if not 2.0 * tail <= t.allowed * t.brightest[k * t.n_in + i]:
                    t.counts[0] = m + 1
                    break
    return 0
