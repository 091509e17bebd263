"""Corner cases by name, and the facts that any correct method must respect in them."""
