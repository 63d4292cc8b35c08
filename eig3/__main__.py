"""`python -m eig3` is the `eig3` command."""

import sys

from .cli import main

sys.exit(main())
