"""The term that no known effect expresses: its port and signals, its curve, its closed form."""
