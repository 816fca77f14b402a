"""Rigged bodies: kinematics, root frame, motion features, seeds, preroll."""
