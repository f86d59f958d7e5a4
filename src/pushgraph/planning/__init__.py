"""Choose tools and pushes that bring objects to goals, over any dynamics and any cost."""
