"""Control over rollouts: pause, resume, approval, dry run, what follows at the threshold, and after a job's end."""
