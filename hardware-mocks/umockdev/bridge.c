/* Lets programs on this machine open emulated USB devices without a kernel module.
 *
 * usage: umockdev-wrapper bridge FOLDER COMMAND [ARGUMENT...]
 *
 * For each socket in FOLDER (erfgs-usbd --sockets FOLDER) a device of the USB bus appears to COMMAND, whose usbfs calls
 * libumockdev intercepts. This bridge carries their transfers over the socket as USB/IP messages and answers the other
 * calls itself. No device knowledge is here: descriptors are read from the device.
 *
 * One main loop serves all calls, so that no locking is needed.
 */
#include <errno.h>
#include <linux/usbdevice_fs.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <umockdev.h>
#include <unistd.h>

enum { SUBMIT = 1, UNLINK = 2, SUBMIT_REPLY = 3, UNLINK_REPLY = 4, HEADER = 48 };

/* A transfer that the program has submitted and not reaped. */
typedef struct {
  guint32 sequence;
  gulong address; /* in the program */
  UMockdevIoctlData *urb, *buffer;
  gboolean done;
} Transfer;

typedef struct {
  int socket;
  guint32 sequence;
  GQueue transfers;
  gboolean gone;
} Device;

static guint32 get32(const guint8 *at) { return (guint32)at[0] << 24 | at[1] << 16 | at[2] << 8 | at[3]; }

static void put32(guint8 *at, guint32 value) {
  at[0] = value >> 24, at[1] = value >> 16, at[2] = value >> 8, at[3] = value;
}

static gboolean transmit(Device *device, const void *data, size_t length) {
  for (const guint8 *at = data; length > 0;) {
    ssize_t sent = send(device->socket, at, length, MSG_NOSIGNAL);
    if (sent <= 0) {
      device->gone = TRUE;
      return FALSE;
    }
    at += sent, length -= sent;
  }
  return TRUE;
}

static gboolean receive(Device *device, void *data, size_t length) {
  for (guint8 *at = data; length > 0;) {
    ssize_t got = recv(device->socket, at, length, 0);
    if (got <= 0) {
      device->gone = TRUE;
      return FALSE;
    }
    at += got, length -= got;
  }
  return TRUE;
}

/* Sends a SUBMIT; returns its sequence number. `setup` is that of a control transfer, or NULL. */
static guint32 submit(Device *device, guint8 endpoint, const guint8 *setup, const guint8 *data, guint32 length) {
  guint8 header[HEADER] = {0};
  gboolean to_host = ((setup ? setup[0] : endpoint) & 0x80) != 0;
  put32(header, SUBMIT);
  put32(header + 4, ++device->sequence);
  put32(header + 12, to_host);
  put32(header + 16, endpoint & 0x0f);
  put32(header + 24, length);
  if (setup) memcpy(header + 40, setup, 8);
  if (transmit(device, header, HEADER) && !to_host && length > 0) transmit(device, data, length);
  return device->sequence;
}

static void finish(Transfer *transfer, gint32 status, gint32 count) {
  umockdev_ioctl_data_update(transfer->urb, G_STRUCT_OFFSET(struct usbdevfs_urb, status), (guint8 *)&status, 4);
  umockdev_ioctl_data_update(transfer->urb, G_STRUCT_OFFSET(struct usbdevfs_urb, actual_length), (guint8 *)&count, 4);
  transfer->done = TRUE;
}

static Transfer *find(Device *device, guint32 sequence) {
  for (GList *link = device->transfers.head; link; link = link->next) {
    Transfer *transfer = link->data;
    if (transfer->sequence == sequence) return transfer;
  }
  return NULL;
}

/* Takes one reply. `wait`: blocks until there is one. */
static gboolean take_reply(Device *device, gboolean wait) {
  struct pollfd ready = {.fd = device->socket, .events = POLLIN};
  if (device->gone || poll(&ready, 1, wait ? -1 : 0) <= 0) return FALSE;
  guint8 header[HEADER];
  if (!receive(device, header, HEADER)) return FALSE;
  guint32 kind = get32(header);
  gint32 status = (gint32)get32(header + 20), count = (gint32)get32(header + 24);
  if (kind != SUBMIT_REPLY) return TRUE;
  Transfer *transfer = find(device, get32(header + 4));
  struct usbdevfs_urb *urb = transfer ? (struct usbdevfs_urb *)transfer->urb->data : NULL;
  gboolean control = urb && urb->type == USBDEVFS_URB_TYPE_CONTROL;
  gboolean to_host = urb && ((control ? transfer->buffer->data[0] : urb->endpoint) & 0x80) != 0;
  if (to_host && count > 0) {
    g_autofree guint8 *data = g_malloc(count);
    if (!receive(device, data, count)) return FALSE;
    umockdev_ioctl_data_update(transfer->buffer, control ? 8 : 0, data, count);
  }
  if (transfer) finish(transfer, status, count);
  return TRUE;
}

/* A control transfer of our own, before the program runs. Returns how many bytes came. */
static gssize control_in(Device *device, guint8 type, guint8 request, guint16 value, guint16 index, guint8 *data, guint16 length) {
  guint8 setup[8] = {type, request, value & 255, value >> 8, index & 255, index >> 8, length & 255, length >> 8};
  guint8 header[HEADER];
  submit(device, 0, setup, NULL, length);
  if (!receive(device, header, HEADER)) return -1;
  gint32 count = (gint32)get32(header + 24);
  if (count > 0 && (count > length || !receive(device, data, count))) return -1;
  return (gint32)get32(header + 20) < 0 ? -1 : count;
}

/* A control transfer without data that the kernel would send for a call. */
static gboolean control_out(Device *device, guint8 type, guint8 request, guint16 value, guint16 index) {
  guint8 setup[8] = {type, request, value & 255, value >> 8, index & 255, index >> 8, 0, 0};
  submit(device, 0, setup, NULL, 0);
  guint32 sequence = device->sequence;
  /* Replies of others may come first. */
  while (!device->gone) {
    guint8 header[HEADER];
    struct pollfd ready = {.fd = device->socket, .events = POLLIN};
    poll(&ready, 1, -1);
    if (recv(device->socket, header, HEADER, MSG_PEEK | MSG_WAITALL) < HEADER) break;
    if (get32(header) == SUBMIT_REPLY && get32(header + 4) == sequence) {
      receive(device, header, HEADER);
      return (gint32)get32(header + 20) == 0;
    }
    take_reply(device, TRUE);
  }
  device->gone = TRUE;
  return FALSE;
}

static void discard(Device *device, Transfer *transfer) {
  guint8 header[HEADER] = {0};
  put32(header, UNLINK);
  put32(header + 4, ++device->sequence);
  put32(header + 20, transfer->sequence);
  transmit(device, header, HEADER);
  /* The reply to the transfer may be on its way; after the reply to the UNLINK it is not. */
  guint32 unlink = device->sequence;
  while (!device->gone) {
    guint8 peek[HEADER];
    if (recv(device->socket, peek, HEADER, MSG_PEEK | MSG_WAITALL) < HEADER) break;
    gboolean ours = get32(peek) == UNLINK_REPLY && get32(peek + 4) == unlink;
    take_reply(device, TRUE);
    if (ours) break;
  }
  if (!transfer->done) finish(transfer, -ENOENT, 0);
}

static int submit_urb(Device *device, UMockdevIoctlData *argument) {
  struct usbdevfs_urb *urb = (struct usbdevfs_urb *)argument->data;
  if (urb->type != USBDEVFS_URB_TYPE_CONTROL && urb->type != USBDEVFS_URB_TYPE_BULK && urb->type != USBDEVFS_URB_TYPE_INTERRUPT)
    return EINVAL;
  Transfer *transfer = g_new0(Transfer, 1);
  transfer->address = argument->client_addr;
  transfer->urb = umockdev_ioctl_data_ref(argument);
  transfer->buffer = umockdev_ioctl_data_resolve(argument, G_STRUCT_OFFSET(struct usbdevfs_urb, buffer), urb->buffer_length, NULL);
  guint8 *data = transfer->buffer ? transfer->buffer->data : NULL;
  if (urb->type == USBDEVFS_URB_TYPE_CONTROL)
    transfer->sequence = submit(device, 0, data, data + 8, urb->buffer_length - 8);
  else
    transfer->sequence = submit(device, urb->endpoint, NULL, data, urb->buffer_length);
  g_queue_push_tail(&device->transfers, transfer);
  return device->gone ? ENODEV : 0;
}

/* The first transfer that is done, taken off the list. */
static Transfer *reap(Device *device) {
  while (take_reply(device, FALSE)) {
  }
  for (GList *link = device->transfers.head; link; link = link->next) {
    Transfer *transfer = link->data;
    if (device->gone && !transfer->done) finish(transfer, -ENODEV, 0);
    if (transfer->done) {
      g_queue_delete_link(&device->transfers, link);
      return transfer;
    }
  }
  return NULL;
}

static gboolean on_ioctl(UMockdevIoctlBase *base, UMockdevIoctlClient *client, gpointer data) {
  (void)base;
  Device *device = data;
  gulong request = umockdev_ioctl_client_get_request(client);
  UMockdevIoctlData *pointer = umockdev_ioctl_client_get_arg(client);
  if (_IOC_TYPE(request) != 'U') {
    umockdev_ioctl_client_complete(client, -1, ENOTTY);
    return TRUE;
  }
  g_autoptr(UMockdevIoctlData) argument = NULL;
  if (_IOC_DIR(request) != _IOC_NONE && _IOC_SIZE(request) > 0) {
    argument = umockdev_ioctl_data_resolve(pointer, 0, _IOC_SIZE(request), NULL);
    if (!argument) {
      umockdev_ioctl_client_complete(client, -1, EFAULT);
      return TRUE;
    }
  }
  int error = 0;
  switch (request) {
    case USBDEVFS_GET_CAPABILITIES: {
      guint32 can = USBDEVFS_CAP_BULK_CONTINUATION | USBDEVFS_CAP_NO_PACKET_SIZE_LIM | USBDEVFS_CAP_BULK_SCATTER_GATHER;
      umockdev_ioctl_data_update(argument, 0, (guint8 *)&can, sizeof can);
      break;
    }
    case USBDEVFS_SUBMITURB:
      error = device->gone ? ENODEV : submit_urb(device, argument);
      break;
    case USBDEVFS_DISCARDURB: {
      error = EINVAL;
      for (GList *link = device->transfers.head; link; link = link->next) {
        Transfer *transfer = link->data;
        if (transfer->address == *(gulong *)pointer->data && !transfer->done) {
          discard(device, transfer);
          error = 0;
          break;
        }
      }
      break;
    }
    case USBDEVFS_REAPURB:
    case USBDEVFS_REAPURBNDELAY: {
      Transfer *transfer = reap(device);
      if (transfer) {
        umockdev_ioctl_data_set_ptr(argument, 0, transfer->urb);
        umockdev_ioctl_data_unref(transfer->urb);
        if (transfer->buffer) umockdev_ioctl_data_unref(transfer->buffer);
        g_free(transfer);
      } else {
        error = device->gone ? ENODEV : EAGAIN;
      }
      break;
    }
    case USBDEVFS_GETDRIVER:
      error = ENODATA;
      break;
    case USBDEVFS_CLEAR_HALT:
      if (!control_out(device, 0x02, 1, 0, *(guint32 *)argument->data)) error = EPIPE;
      break;
    case USBDEVFS_SETCONFIGURATION:
    case USBDEVFS_CLAIMINTERFACE:
    case USBDEVFS_RELEASEINTERFACE:
    case USBDEVFS_SETINTERFACE:
    case USBDEVFS_DISCONNECT_CLAIM:
    case USBDEVFS_IOCTL:
    case USBDEVFS_RESET:
      break;
    default:
      error = ENOTTY;
  }
  if (error)
    umockdev_ioctl_client_complete(client, -1, error);
  else
    umockdev_ioctl_client_complete(client, 0, 0);
  return TRUE;
}

static Device *add(UMockdevTestbed *testbed, const char *path, int number) {
  Device *device = g_new0(Device, 1);
  g_queue_init(&device->transfers);
  struct sockaddr_un address = {.sun_family = AF_UNIX};
  g_strlcpy(address.sun_path, path, sizeof address.sun_path);
  device->socket = socket(AF_UNIX, SOCK_STREAM, 0);
  if (device->socket < 0 || connect(device->socket, (struct sockaddr *)&address, sizeof address) < 0) {
    fprintf(stderr, "bridge: cannot connect to %s: %s\n", path, strerror(errno));
    return NULL;
  }
  guint8 descriptors[4096];
  gssize first = control_in(device, 0x80, 6, 0x0100, 0, descriptors, 18);
  gssize rest = control_in(device, 0x80, 6, 0x0200, 0, descriptors + 18, sizeof descriptors - 18);
  if (first != 18 || rest < 9) {
    fprintf(stderr, "bridge: %s does not tell its descriptors\n", path);
    return NULL;
  }
  g_autoptr(GString) hex = g_string_new(NULL);
  for (gssize i = 0; i < first + rest; i++) g_string_append_printf(hex, "%02X", descriptors[i]);
  guint vendor = descriptors[8] | descriptors[9] << 8, product = descriptors[10] | descriptors[11] << 8;
  g_autofree char *node = g_strdup_printf("/dev/bus/usb/002/%03d", number);
  g_autofree char *text = g_strdup_printf(
      "P: /devices/pci0000:00/0000:00:14.0/usb2/2-%d\nN: bus/usb/002/%03d=%s\nE: BUSNUM=002\nE: DEVNUM=%03d\n"
      "E: DEVNAME=%s\nE: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\nE: ID_VENDOR_ID=%04x\nE: ID_MODEL_ID=%04x\nE: MAJOR=189\n"
      "E: MINOR=%d\nA: bConfigurationValue=1\\n\nA: busnum=2\\n\nA: devnum=%d\\n\nA: idVendor=%04x\\n\nA: idProduct=%04x\\n\n"
      "A: bNumConfigurations=1\\n\nA: speed=%s\\n\nH: descriptors=%s\n\n",
      number, number, hex->str, number, node, vendor, product, 127 + number, number, vendor, product,
      descriptors[3] == 3 ? "5000" : "480", hex->str);
  g_autoptr(GError) error = NULL;
  UMockdevIoctlBase *handler = umockdev_ioctl_base_new();
  g_signal_connect(handler, "handle-ioctl", G_CALLBACK(on_ioctl), device);
  if (!umockdev_testbed_add_from_string(testbed, text, &error) || !umockdev_testbed_attach_ioctl(testbed, node, handler, &error)) {
    fprintf(stderr, "bridge: %s: %s\n", path, error->message);
    return NULL;
  }
  return device;
}

static void on_exit_of_child(GPid pid, gint status, gpointer data) {
  (void)pid;
  int *code = data;
  *code = WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

int main(int count, char **arguments) {
  if (count < 3) {
    fprintf(stderr, "usage: umockdev-wrapper bridge FOLDER COMMAND [ARGUMENT...]\n");
    return 2;
  }
  g_autoptr(GError) error = NULL;
  UMockdevTestbed *testbed = umockdev_testbed_new();
  g_autoptr(GDir) folder = g_dir_open(arguments[1], 0, &error);
  if (!folder) {
    fprintf(stderr, "bridge: %s\n", error->message);
    return 1;
  }
  const char *name;
  for (int number = 1; (name = g_dir_read_name(folder));) {
    if (!g_str_has_suffix(name, ".sock")) continue;
    g_autofree char *path = g_build_filename(arguments[1], name, NULL);
    if (!add(testbed, path, number++)) return 1;
  }
  GPid pid;
  if (!g_spawn_async(NULL, arguments + 2, NULL, G_SPAWN_DO_NOT_REAP_CHILD | G_SPAWN_SEARCH_PATH | G_SPAWN_CHILD_INHERITS_STDIN, NULL,
                     NULL, &pid, &error)) {
    fprintf(stderr, "bridge: %s\n", error->message);
    return 1;
  }
  int code = -1;
  g_child_watch_add(pid, on_exit_of_child, &code);
  while (code < 0) g_main_context_iteration(NULL, TRUE);
  return code;
}
