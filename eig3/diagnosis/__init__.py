"""The analysis of systems and runs: linearisation, critical steps, causes of divergence, errors and stiffness."""
