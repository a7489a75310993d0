"""Motion models, camera, rotations and orientation."""
