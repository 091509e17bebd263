"""Joints that give: elastic faces without tension, stepped with all voussoirs."""
