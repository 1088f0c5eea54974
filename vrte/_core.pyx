# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""The compiled loops: arrays in, arrays out, no class of the package, the caller owns every buffer.

Matrices are stored column by column, so in the shapes below the *last* axis is the row. `n` is S N: node by
node, S Stokes parameters inside: all four, or those of a set that mixes with no other. Inside the solver the
unknowns on the nodes are scaled by sqrt(weight mu) and the upward field is flipped by D = diag(1, 1, -1, -1)
(handbook: docs/reference/conventions.md). s and d are the sum and the difference of the two hemispheres. (1:n) is equation n
of Collin, Pattanaik and Bouatouch, (2:n) of Budak and Efremenko. docs/how_to/core.md says where a new stage goes.

A complex pair of modes occupies two columns, Re v and Im v, and two real coordinates y1, y2 with
s = Re[v (y1 - i y2)]: a function of lambda multiplies the complex number y1 - i y2.

Every stage takes a crew, (threads, seconds, stop), and its arrays by name, and leaves LAPACK's verdict in `info`
(0: fine): see core/running.pxi.
"""

import sys

import numpy as np

from cython.parallel cimport prange, threadid
from libc.math cimport (
    INFINITY, M_PI as PI, acos, asin, atan, atan2, cbrt, cos, erfc, exp, expm1, fabs, fmax, hypot, sin, sqrt, tan,
    tanh)
from libc.string cimport memcpy, memset
from scipy.linalg.cython_blas cimport ddot, dgemm, dgemv, idamax
from scipy.linalg.cython_lapack cimport dgeevx, dgetrf, dgetri, dgetrs, dsyevd

# What the stages stand on.
include "core/running.pxi"
include "core/complex.pxi"
include "core/matrices.pxi"

# Before a solve: a sphere, the phase matrices A^m, what each order can do.
include "core/mie.pxi"
include "core/spherical.pxi"
include "core/parity.pxi"
include "core/bounds.pxi"

# Rough surfaces and oriented flakes, order by order.
include "core/facets.pxi"
include "core/flakes.pxi"

# Sections 2.C and 3.A of the GPU paper, one Fourier order and layer at a time.
include "core/assembly.pxi"
include "core/flux.pxi"
include "core/homogeneous.pxi"
include "core/particular.pxi"
include "core/adding.pxi"
include "core/boundary.pxi"
include "core/reconstruction.pxi"
include "core/fused_modes.pxi"

# The same fields without an eigenproblem: slabs doubled and joined, a semi-infinite layer by invariance.
include "core/extended.pxi"
include "core/doubling.pxi"
include "core/joining.pxi"
include "core/response.pxi"
include "core/stack.pxi"
include "core/invariance.pxi"
include "core/invariance_change.pxi"
include "core/derivatives.pxi"
include "core/slab_change.pxi"
include "core/moment_gmres.pxi"

# The end of a solve: all orders added up, and what is scattered once.
include "core/sums.pxi"
include "core/single_scattering.pxi"

# Beside all that: photons, one by one.
include "core/photons.pxi"

# Every stage, by its declaration in core/stages.toml.
include "stages.pxi"
