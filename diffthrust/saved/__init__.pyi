from ._load import load as load
