"""Running stored jobs, each by one worker at a time, and telling Prefect of flow runs: ends, signs of life, deaths."""
