"""Programs that make checkpoints: `python -m train generator=modi data=FOLDER`."""
