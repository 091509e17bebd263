"""What a method does to a fragility curve, its cost, and how much of the spread is numerical."""
