"""What stands behind a deleted thing: continued from what photos showed around it."""
