"""One task run for a whole `map`, for any flow of Prefect."""
