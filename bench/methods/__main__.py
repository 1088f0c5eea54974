"""`python -m bench.methods docs/explanation/methods.md` brings its tables up to date."""

import sys

from bench.methods.registry import main

sys.exit(main(sys.argv[1]))
