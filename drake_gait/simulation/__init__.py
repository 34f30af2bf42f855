"""One walk: from a robot description and a candidate to what the robot did, in Drake."""
