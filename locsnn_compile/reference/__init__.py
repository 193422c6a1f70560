"""What the network's author means, evaluated with numpy alone."""
