"""Bodies with thrusters placed on them."""
