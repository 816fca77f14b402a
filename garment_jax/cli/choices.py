"""What options may be chosen of, kept here so that `--help` need import nothing else."""

GARMENTS = ("skirt", "circle_skirt", "dress", "cape")  # as procedural.scene
