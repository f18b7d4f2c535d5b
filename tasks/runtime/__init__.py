"""The processes that run one simulation job."""
