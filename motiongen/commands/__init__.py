"""One module per command of the command line; nothing imports them but `motiongen.cli`."""
