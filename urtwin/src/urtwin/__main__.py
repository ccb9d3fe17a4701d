"""`python -m urtwin` is `urtwin`."""

import sys

from urtwin.command import main

if __name__ == "__main__":
    sys.exit(main())
