"""Forces of effects on a few points, beside those that LAMMPS and OpenMM compute."""
