"""What a route finds of some Fourier orders."""

from vrte.basics.arrays import Array, record


@record
class Orders:
    """Multiply scattered light of some Fourier orders.

    kernels (order, n_tau, n_in, n_col, n_out, S): radiance for a unit beam, public frame; flux_up, flux_down (n_tau,
    n_in, n_col): of the first of the orders, all diffuse light on the nodes; residuals: how well the route's own
    equations hold, by name, each (order,).
    """

    kernels: Array
    flux_up: Array
    flux_down: Array
    residuals: dict[str, Array]
