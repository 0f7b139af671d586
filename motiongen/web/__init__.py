"""The page in the browser (`motiongen serve`): who may come in, what a visitor sees, and the work they ask for."""
