from diffthrust._support.names import nearest  # private: what every message says of a slip


def test_letters_that_changed_places_are_seen_through():
    columns = ["t_ms", "rpm", "pwm", "thrust_kgf"]
    assert nearest("pmw", columns) == "the nearest is 'pwm'"
    assert nearest("Rmp ", columns) == "the nearest is 'rpm'"
    assert nearest("thrust", columns, "; ") == "; the nearest is 'thrust_kgf'"
    assert nearest("heading", columns) == ""
