"""parmps: violent sloshing by the Moving Particle Semi-implicit method, in parallel."""

__version__ = "0.1.0"
