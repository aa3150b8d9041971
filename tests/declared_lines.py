"""How parameters are declared, a line each: what tables of declarations are compared by."""


def declared_line(name, p):
    """Value with unit, bounds, and what else is not usual."""
    told = [f"{name} = {p.value!r} {p.pattern or p.unit}".rstrip()]
    told.append(" ".join("-" if b is None else f"{b:.4g}" for b in p.bounds))
    told += [p.transform] * (p.transform != "linear") + ["fixed"] * p.fixed
    if p.null is not None:
        told.append(f"null {p.null:g}")
    if p.size is not None:
        told.append(f"size {p.size:g}")
    factors = getattr(p.probes, "factors", p.probes)
    if factors:
        told.append("probes " + " ".join(f"{x:g}" for x in factors))
    if factors is not p.probes:
        told[-1] += f" of {p.probes.signal}" + f"^{p.probes.power:g}" * (p.probes.power != 1.0)
    return "; ".join(told)


def declared_text(classes):
    """The lines of all parameters of these classes, in the order of their names."""
    return "\n".join(
        declared_line(f"{name}.{key}", p)
        for name, cls in sorted(classes.items())
        for key, p in cls.declared.items()
    )
