"""`python -m vrte.studies.methods docs/explanation/methods.md` brings its tables up to date."""

import sys

from vrte.studies.methods.registry import main

sys.exit(main(sys.argv[1]))
