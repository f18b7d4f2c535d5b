"""Control over rollouts: pause, resume, approval, dry run, rollback at the failure threshold."""
