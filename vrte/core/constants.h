/* Numbers that the compiled core and the OpenCL kernels share; Python has them as attributes of vrte._core. */

#define SEMI_INFINITE 1e300         /* optical thickness: beyond it a layer has no bottom */
#define DECAYING 4.0            /* e-folds from face to face: where every mode loses more, each is of its own face */
#define RESONANT 0.02         /* k mu and 1: closer than this a mode is in resonance with a direction */
#define NO_LIGHT 1e-280       /* below, denormal numbers have no digits to check */
#define ROUNDING 4e-16        /* of the quadrature of a base's operator, not a loss */

/* impedance doubling */
#define THICK 1.5             /* optical thickness: beyond it Zo may be as large as the slab is thick */
#define COMPLEMENTED 0.75     /* optical thickness up to which 1 - Zo Ze keeps its digits */
#define STEEPEST_RATIO 1e-3   /* of eigenvalues: the condition of L = 1 + Zo Ze is not let above its inverse */
#define MOST_DOUBLINGS 100    /* of a semi-infinite slab */

/* invariance */
#define MOST_STEPS 400        /* fixed points */
#define FEWEST_TO_HALVE 12    /* nodes: of fewer, half are no better a start than R = 0 */
#define WEAKEST_RATE 0.02     /* of a step: below, R = 0 is as good a start as half of the nodes */
#define NEAR 0.1              /* by how much, of its largest, R may move from half of the nodes to all */
#define OF_HALF 1e-4          /* tolerance on half of the nodes: interpolation is off by as much */

/* the end of a solve */
#define SERIES 13             /* numbers of one degree in a table of the phase matrix */
#define MOST_COLUMNS 16       /* incident Stokes vectors at once */
#define MOST_ENTRIES 64       /* columns times Stokes components */
