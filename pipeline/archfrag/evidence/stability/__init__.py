"""Maps of what goes wrong where: diverged, drifted, gained energy, penetrated, hung, misjudged."""
