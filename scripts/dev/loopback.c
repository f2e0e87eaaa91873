/* Restrict the XML-RPC server of roscpp to the loopback interface, because it ignores ROS_HOSTNAME.
 * Scripts preload this library. It replaces the method XmlRpc::XmlRpcSocket::bind(int, int), so it
 * has no effect on programs without roscpp. */
#include <netinet/in.h>
#include <stdbool.h>
#include <sys/socket.h>

bool _ZN6XmlRpc12XmlRpcSocket4bindEii(int fd, int port) {
  struct sockaddr_in v4 = {.sin_family = AF_INET, .sin_port = htons(port)};
  struct sockaddr_in6 v6 = {.sin6_family = AF_INET6, .sin6_port = htons(port)};
  int domain = AF_INET;
  socklen_t size = sizeof domain;
  v4.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  v6.sin6_addr = in6addr_loopback;
  getsockopt(fd, SOL_SOCKET, SO_DOMAIN, &domain, &size);
  if (domain == AF_INET6) { /* ROS_IPV6=on */
    return bind(fd, (struct sockaddr *)&v6, sizeof v6) == 0;
  }
  return bind(fd, (struct sockaddr *)&v4, sizeof v4) == 0;
}
