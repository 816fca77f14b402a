import numpy as np
import pytest

from garment_jax.procedural.cape import make_cape
from garment_jax.procedural.circle_skirt import make_circle_skirt
from garment_jax.procedural.cone_skirt import make_cone_skirt
from garment_jax.procedural.dress import make_dress
from tests.procedural.bodies import pillar


def test_around_a_pillar_it_is_the_cone_and_its_pattern_the_ring_sector_of_geometry():
    made = make_cone_skirt(*pillar(), length=0.5, slope_degrees=30.0)
    top = made.garment.template[:, 1].max()
    along = (top - made.garment.template[:, 1]) / np.cos(np.radians(30))
    radius = np.linalg.norm(made.garment.template[:, [0, 2]], axis=1)
    np.testing.assert_allclose(radius, 0.126 + along / 2, atol=5e-4)
    assert abs(top - (0.8 + 0.48 * 0.5)) < 1e-6
    # A cone of half angle 30 degrees unrolls to half a ring; slant lengths are radius / sin 30.
    inner, outer = 2 * 0.126, 2 * 0.126 + 0.5
    centre = [0.0, inner]
    distance = np.linalg.norm(made.pattern - centre, axis=1)
    np.testing.assert_allclose([distance.min(), distance.max()], [inner, outer], atol=1e-3)
    seam = made.pattern[np.isin(made.garment.uv[:, 0], [0, 1])]
    np.testing.assert_allclose(seam[:, 0], 0.0, atol=2e-3)  # both sides of the seam on one line: half a turn


def test_pins_of_a_rigid_body_follow_it_whole():
    made = make_cone_skirt(*pillar())
    np.testing.assert_array_equal(made.pins.weights, np.tile([1.0, 0.0], (len(made.pins.vertices), 1)))


def test_the_waist_can_be_put_elsewhere():
    made = make_cone_skirt(*pillar(), height=1.5)
    assert abs(made.garment.template[:, 1].max() - 1.5) < 1e-6


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"length": 2.0}, r"length=2\.0 m must lie between 0\.1 and 0\.9"),
        ({"slope_degrees": 0.0}, r"slope_degrees=0\.0 must lie between 0 and 80"),
        ({"vertices": 5}, "--vertices 5 must lie between 100 and 100000"),
        ({"height": 3.0}, r"height=3 misses the collider, which spans 0 to 2 m"),
    ],
)
def test_refusals(options, sentence):
    with pytest.raises(ValueError, match=sentence):
        make_cone_skirt(*pillar(), **options)


def test_a_slope_that_leaves_it_inside_the_body_is_refused():
    wide_hips = pillar({0.0: 0.1, 0.7: 0.12, 0.8: 0.2, 0.9: 0.2, 1.0: 0.12, 1.2: 0.12, 2.0: 0.1})
    with pytest.raises(
        ValueError, match=r"slope_degrees=10 puts the skirt within -\d.* mm of .*; make it wider"
    ):
        make_cone_skirt(*wide_hips, slope_degrees=10.0)
    make_cone_skirt(*wide_hips, slope_degrees=40.0)


def test_the_other_garments_refuse_numbers_out_of_range():
    with pytest.raises(ValueError, match="folds=5 must be even and at least 4"):
        make_circle_skirt(*pillar(), folds=5)
    with pytest.raises(ValueError, match=r"slope_degrees=85.0 must lie between 20 and 80"):
        make_circle_skirt(*pillar(), slope_degrees=85.0)
    with pytest.raises(ValueError, match=r"length=2\.0 m must lie between 0\.1 and 0\.9"):
        make_dress(*pillar(), length=2.0)
    with pytest.raises(ValueError, match=r"flare_degrees=90\.0 must lie between 0 and 40"):
        make_cape(*pillar(), flare_degrees=90.0)
