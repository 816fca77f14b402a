"""`--quick`: the same benchmark in ten minutes, to see that everything works; its figures mean nothing."""

import dataclasses

from garment_jax.bench.settings import Loaded, Search

CLIPS, LENGTH = 0.2, 0.06  # part of the training clips and of every number of steps


def quick_version(loaded: Loaded) -> Loaded:
    """Return the benchmark with few clips, few steps, one seed and the first group of rows only."""
    settings = loaded.settings
    group = next(word for word in settings.order if any(row.group == word for row in settings.rows))
    rows = tuple(
        dataclasses.replace(row, seeds=row.seeds[:1], part=min(row.part, CLIPS), length=row.length * LENGTH)
        for row in settings.rows
        if row.group == group or row.name == settings.reference
    )
    timing = dataclasses.replace(settings.timing, frames=min(settings.timing.frames, 200), steps=50)
    order = tuple(word for word in settings.order if any(row.group == word for row in rows))
    quick = dataclasses.replace(
        settings,
        title=f"{settings.title} (quick: these figures mean nothing)",
        rows=rows,
        order=order,
        search=Search(),
        timing=timing,
        every=max(settings.every, 100),
        simulator_frames=min(settings.simulator_frames, 5),
    )
    return Loaded(quick, loaded.base, loaded.folder)
