"""Speed of renders, compared with the time of their Embree calls alone."""
