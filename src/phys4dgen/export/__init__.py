"""What a run leaves behind: frames, trajectory, video, pictures and the facts about a file."""
