"""Cost against error of every method on every scene, each error against its reference."""
