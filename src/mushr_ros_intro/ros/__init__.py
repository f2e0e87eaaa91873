"""The only folder of the library that imports rospy or messages."""
