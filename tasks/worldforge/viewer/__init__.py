"""Pages and pictures that show worlds: the 3-D page, contact sheets, catalogue sheets."""
