"""What sensors say of the surroundings: messages in, beams and a local grid out."""
