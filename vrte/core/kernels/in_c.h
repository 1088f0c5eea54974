/* Scalar mathematics that the compiled core and the OpenCL kernels share, as the core includes it. The headers are C99
   and OpenCL C 1.2: `real` is what a program computes with, `lanes` one number of it or four, `mask` what comparing
   them gives; cl/common.cl has these names for a device. */
#pragma once
#include <math.h>

#include "../constants.h"
#include "../wide.h"

typedef double real;
typedef double lanes;
typedef int mask;
#define VRTE_SHARED VRTE_INLINE
#define VRTE_LIST static const
#define STORED const
#define DOUBLED 1e-9      /* distance of Zo Ze of a semi-infinite slab from 1 before the last doubling */
#define INDEPENDENT 1e-10 /* of two steps: the determinant of their products over the product of their squares */

#include "complexes.h"
#include "paths.h"
#include "wigner.h"
#include "series.h"
#include "steps.h"
#include "doubling.h"
