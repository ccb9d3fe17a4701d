"""`python -m dynid` is `dynid`."""

import sys

from dynid.cli.app import main

if __name__ == "__main__":
    sys.exit(main())
