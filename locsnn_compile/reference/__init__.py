"""The network as its author means it, evaluated with numpy only."""
