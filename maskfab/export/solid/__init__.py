"""Writers of three-dimensional files: STEP and meshes."""
