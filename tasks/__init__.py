"""The steps that flows are made of, and the engines behind them."""
