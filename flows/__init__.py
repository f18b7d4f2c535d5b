"""Every RoboMaker operation as a Prefect flow."""
