"""`python -m garment_jax COMMAND`: the same as `garment-jax COMMAND`."""

from garment_jax.cli import program

if __name__ == "__main__":
    program()
