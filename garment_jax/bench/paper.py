"""What the paper reports, as ratios: the only numbers of the report that were not measured here.

Garment Animation via Generative Model of Deformation Decomposition (3DV 2024), Tables 1 to 4. Its data
and units are its own; a ratio between two of its rows is what carries over to other data.
"""

METRICS = ("rmse_cm", "hausdorff_cm", "sted")

# Table 3, ours divided by the other: RMSE, Hausdorff, STED
SKIRT = {"santesteban_2019": (0.617, 0.788, 0.831), "pan_2022": (0.748, 0.869, 0.919)}
# Table 4, the dress of the vto-dataset
VTO = {"santesteban_2019": (0.769, 0.882, 0.922), "pan_2022": (0.810, 0.920, 0.952)}
# Table 1, with previous state divided by without, after so many frames
PREVIOUS_STATE = {
    "walk": {100: 0.955, 500: 0.945, 1200: 0.926},
    "ballet": {100: 0.939, 500: 0.926, 1200: 0.910},
}
# Table 2, the whole detail module divided by none
DETAIL = {"walk": 0.912, "ballet": 0.931, "folk dance": 0.932}
