"""Motion generators behind one interface: `base` is the contract, `registry` finds them, `constraints` steer them."""
