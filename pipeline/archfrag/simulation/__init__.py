"""From an arch and ground motions to onsets, responses and rows of results."""
