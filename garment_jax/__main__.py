"""`python -m garment_jax COMMAND`: the same as `garment-jax COMMAND`."""

import sys

from garment_jax.cli import main

if __name__ == "__main__":
    sys.exit(main())
