"""`python -m vrte.report.methods docs/methods.md` brings the table of methods there up to date."""

import sys

from vrte.report.methods.registry import main

sys.exit(main(sys.argv[1]))
