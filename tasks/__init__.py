"""Steps that flows consist of, and the engines behind them: catalog, storage, WorldForge, runtime, reporting."""
