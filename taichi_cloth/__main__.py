"""python -m taichi_cloth"""

import sys

from .app.cli import main

sys.exit(main())
