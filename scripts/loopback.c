/* Restrict TCP servers to the loopback interface if they listen on every interface. Scripts preload
 * this library, because the XML-RPC server of roscpp ignores ROS_HOSTNAME. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <netinet/in.h>
#include <string.h>
#include <sys/socket.h>

int bind(int fd, const struct sockaddr *address, socklen_t length) {
  int (*next)(int, const struct sockaddr *, socklen_t);
  struct sockaddr_in local;
  int type;
  socklen_t size = sizeof type;
  *(void **)&next = dlsym(RTLD_NEXT, "bind");
  if (address && length >= sizeof local && address->sa_family == AF_INET &&
      getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) == 0 && type == SOCK_STREAM) {
    memcpy(&local, address, sizeof local);
    if (local.sin_addr.s_addr == htonl(INADDR_ANY)) {
      local.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
      return next(fd, (struct sockaddr *)&local, sizeof local);
    }
  }
  return next(fd, address, length);
}
