"""The reference against which chips are compared: the trained network, evaluated with numpy only."""
