"""The hidden-effect bench: does a diagnosis find what a plant has and its model lacks?

The plants are those of the independent reference simulator (`reference`), so nothing here shares
code with the effects under test. A set is two logs to train on and one unseen, drawn from a kind
and a seed:

    from hidden import sets
    hidden = sets.draw("field-clear/coulomb_friction", seed=3)
    hidden.model, hidden.train, hidden.unseen, hidden.truth

The whole bench, from the folder ``tests``: ``python -m hidden.bench --out results.jsonl``.
"""
