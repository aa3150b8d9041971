"""How a diagnosis is reported: sentences, rows, figures, and the sections that hold them."""
