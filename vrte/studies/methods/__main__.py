"""`python -m vrte.studies.methods docs/methods.md` brings the tables of methods and rules there up to date."""

import sys

from vrte.studies.methods.registry import main

sys.exit(main(sys.argv[1]))
