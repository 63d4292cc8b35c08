"""What is found out about a system and a method: linearisation, critical steps, causes of divergence."""
