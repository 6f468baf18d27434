// V4L2 cameras in user space, for LD_PRELOAD: the nodes are the files in $ERFGS_CAMERAS (video0, video1, ..), each a
// camera described by lines "key value" that are read when it is opened:
//
//   card NAME, bus PLACE     what it calls itself
//   metadata 1               a metadata node of the camera before it: no frames
//   format FOURCC WIDTH HEIGHT PADDING   what it sends; PADDING bytes follow each row
//   fps N                    frames a second
//   clock monotonic|other, point soe|eof   what its stamps are
//   skip N, damage N, cut N, empty N       frame N: lost before us / error flag / short / no bytes
//   die N                    gives no frame from frame N on
//   unplug N                 its node vanishes at frame N, and what has it open is answered ENODEV
//   busy 1                   another program streams
//
// An open node is a memory file, so that mmap and close need no help; open, ioctl and poll do. It has the controls of a
// UVC camera: exposure, gain, white balance, each with its automatic. Frame N is filled with the byte N (MJPG: a JPEG's
// first and last bytes around it). Follows the V4L2 user-space API (Linux media documentation), not any program.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define BUFFERS 8
#define DESCRIPTORS 1024
#define CONTROLS 7
#define NEVER (-1)

struct control {
  unsigned id;
  int minimum, maximum, value;
};

struct camera {
  int used, metadata, busy, streaming;
  char path[256], card[32], bus[32];
  unsigned fourcc, width, height, padding;
  double fps;
  unsigned stamp_flags;
  int skip, damage, cut, empty, die, unplug;
  size_t size;
  unsigned char *memory;
  int queue[BUFFERS], queued, buffers;
  int frame;
  double next;
  struct control controls[CONTROLS];
};

static struct camera cameras[DESCRIPTORS];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec + t.tv_nsec * 1e-9;
}

static long fail(int error) {
  errno = error;
  return -1;
}

// Bits of a pixel in a row: 10 and 12 where a format of V4L2 packs them (its documentation, 2.8 and 2.9), 16 in words.
static unsigned bits(unsigned fourcc) {
  const char code[5] = {fourcc, fourcc >> 8, fourcc >> 16, fourcc >> 24, 0};
  static const char *const words[] = {"YUYV", "UYVY", "Y10 ", "Y12 ", "RG10", "BG10", "BA10", "GB10", "RG12", "BG12", "BA12", "GB12"};
  for (unsigned i = 0; i < sizeof words / sizeof *words; i++) {
    if (!strcmp(code, words[i])) return 16;
  }
  if (!strcmp(code, "RGB3") || !strcmp(code, "BGR3")) return 24;
  if (!strcmp(code, "Y10P") || (code[0] == 'p' && code[2] == 'A')) return 10;
  if (!strcmp(code, "Y12P") || (code[0] == 'p' && code[2] == 'C')) return 12;
  return 8;
}

static unsigned stride(const struct camera *c) {
  if (c->fourcc == V4L2_PIX_FMT_MJPEG) return 0;
  return c->width * bits(c->fourcc) / 8 + c->padding;
}

static void describe(struct camera *c, const char *path) {
  memset(c, 0, sizeof *c);
  c->used = 1;
  snprintf(c->path, sizeof c->path, "%s", path);
  c->fps = 100;
  c->fourcc = V4L2_PIX_FMT_YUYV;
  c->width = 64;
  c->height = 48;
  c->stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  c->skip = c->damage = c->cut = c->empty = c->die = c->unplug = NEVER;
  static const struct control controls[CONTROLS] = {
      {V4L2_CID_AUTO_WHITE_BALANCE, 0, 1, 1},   {V4L2_CID_WHITE_BALANCE_TEMPERATURE, 2800, 6500, 4600},
      {V4L2_CID_GAIN, 0, 255, 32},              {V4L2_CID_EXPOSURE_AUTO, 0, 3, 3},
      {V4L2_CID_EXPOSURE_ABSOLUTE, 3, 2047, 250}, {V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0, 1, 1},
      {V4L2_CID_FOCUS_AUTO, 0, 1, 1},
  };
  memcpy(c->controls, controls, sizeof controls);
  FILE *file = fopen(path, "r");
  char line[128], key[32], value[64];
  while (file && fgets(line, sizeof line, file)) {
    if (sscanf(line, "%31s %63[^\n]", key, value) != 2) continue;
    int number = atoi(value);
    if (!strcmp(key, "card")) snprintf(c->card, sizeof c->card, "%.31s", value);
    if (!strcmp(key, "bus")) snprintf(c->bus, sizeof c->bus, "%.31s", value);
    if (!strcmp(key, "metadata")) c->metadata = number;
    if (!strcmp(key, "busy")) c->busy = number;
    if (!strcmp(key, "fps")) c->fps = number;
    if (!strcmp(key, "skip")) c->skip = number;
    if (!strcmp(key, "damage")) c->damage = number;
    if (!strcmp(key, "cut")) c->cut = number;
    if (!strcmp(key, "empty")) c->empty = number;
    if (!strcmp(key, "die")) c->die = number;
    if (!strcmp(key, "unplug")) c->unplug = number;
    if (!strcmp(key, "clock") && !strcmp(value, "other")) c->stamp_flags &= ~V4L2_BUF_FLAG_TIMESTAMP_MASK;
    if (!strcmp(key, "point") && !strcmp(value, "eof")) c->stamp_flags &= ~V4L2_BUF_FLAG_TSTAMP_SRC_MASK;
    if (!strcmp(key, "format")) {
      char code[5] = "    ";
      sscanf(value, "%4c %u %u %u", code, &c->width, &c->height, &c->padding);
      c->fourcc = v4l2_fourcc(code[0], code[1], code[2], code[3]);
    }
  }
  if (file) fclose(file);
  c->size = stride(c) ? (size_t)stride(c) * c->height * (c->fourcc == V4L2_PIX_FMT_NV12 ? 3 : 2) / 2 : 4096;
  if (stride(c) && c->fourcc != V4L2_PIX_FMT_NV12) c->size = (size_t)stride(c) * c->height;
  c->size = (c->size + 4095) / 4096 * 4096;
}

// What the camera sends of a frame, before it is cut.
static size_t frame_bytes(const struct camera *c) {
  if (!stride(c)) return 1000;
  size_t bytes = (size_t)stride(c) * c->height;
  return c->fourcc == V4L2_PIX_FMT_NV12 ? bytes * 3 / 2 : bytes;
}

// A descriptor for a camera's node; -2 if the path is none.
static int open_camera(const char *path) {
  const char *folder = getenv("ERFGS_CAMERAS");
  unsigned number;
  char rest;
  if (!folder || !path || strncmp(path, folder, strlen(folder))) return -2;
  if (sscanf(path + strlen(folder), "/video%u%c", &number, &rest) != 1) return -2;
  static int opening;  // `describe` opens the file itself.
  if (__atomic_exchange_n(&opening, 1, __ATOMIC_ACQUIRE)) return -2;
  int fd = -1;
  if (access(path, R_OK) == 0) {
    struct camera camera;
    describe(&camera, path);
    fd = memfd_create("camera", MFD_CLOEXEC);
    if (fd >= 0 && fd < DESCRIPTORS && ftruncate(fd, camera.size * BUFFERS) == 0) {
      camera.memory = mmap(NULL, camera.size * BUFFERS, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
      cameras[fd] = camera;
    }
  }
  __atomic_store_n(&opening, 0, __ATOMIC_RELEASE);
  return fd;
}

static struct control *control(struct camera *c, unsigned id) {
  for (int i = 0; i < CONTROLS; i++) {
    if (c->controls[i].id == id) return &c->controls[i];
  }
  return NULL;
}

// Whether the camera is unplugged; takes its node away when it is found to be.
static int gone(struct camera *c) {
  if (c->unplug == NEVER || c->frame < c->unplug) return 0;
  if (*c->path) unlink(c->path);
  *c->path = 0;
  return 1;
}

// Whether a frame can be taken.
static int due(struct camera *c) {
  if (!c->streaming || !c->queued || (c->die != NEVER && c->frame >= c->die)) return 0;
  return now() >= c->next;
}

static long take(struct camera *c, struct v4l2_buffer *buffer) {
  if (!c->streaming) return fail(EINVAL);
  if (gone(c)) return fail(ENODEV);
  if (!due(c)) return fail(EAGAIN);
  if (c->frame == c->skip) c->frame++;
  int index = c->queue[0], frame = c->frame++;
  memmove(c->queue, c->queue + 1, --c->queued * sizeof *c->queue);
  unsigned char *bytes = c->memory + (size_t)index * c->size;
  size_t used = frame_bytes(c);
  memset(bytes, frame, used);
  if (!stride(c)) memcpy(bytes, "\xff\xd8", 2), memcpy(bytes + used - 2, "\xff\xd9", 2);
  if (frame == c->cut) used -= 8;
  if (frame == c->empty) used = 0;
  buffer->index = index;
  buffer->bytesused = used;
  buffer->length = c->size;
  buffer->m.offset = index * c->size;
  buffer->sequence = frame;
  buffer->flags = c->stamp_flags | V4L2_BUF_FLAG_MAPPED | (frame == c->damage ? V4L2_BUF_FLAG_ERROR : 0);
  buffer->timestamp.tv_sec = c->next;
  buffer->timestamp.tv_usec = (c->next - (long)c->next) * 1e6;
  c->next += 1 / c->fps;
  return 0;
}

static long answer(struct camera *c, unsigned long request, void *argument) {
  switch (request & 0xffffffff) {
    case VIDIOC_QUERYCAP: {
      struct v4l2_capability *k = argument;
      memset(k, 0, sizeof *k);
      strcpy((char *)k->driver, "uvcvideo");
      memcpy(k->card, c->card, sizeof c->card);
      memcpy(k->bus_info, c->bus, sizeof c->bus);
      k->version = 6 << 16 | 1 << 8;
      k->device_caps = V4L2_CAP_STREAMING | (c->metadata ? V4L2_CAP_META_CAPTURE : V4L2_CAP_VIDEO_CAPTURE);
      k->capabilities = V4L2_CAP_STREAMING | V4L2_CAP_META_CAPTURE | V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_DEVICE_CAPS;
      return 0;
    }
    case VIDIOC_ENUM_FMT: {
      struct v4l2_fmtdesc *f = argument;
      if (f->index || f->type != V4L2_BUF_TYPE_VIDEO_CAPTURE || c->metadata) return fail(EINVAL);
      f->pixelformat = c->fourcc;
      return 0;
    }
    case VIDIOC_S_FMT: {
      struct v4l2_format *f = argument;
      if (f->type != V4L2_BUF_TYPE_VIDEO_CAPTURE || c->metadata) return fail(EINVAL);
      f->fmt.pix.width = c->width;
      f->fmt.pix.height = c->height;
      f->fmt.pix.pixelformat = c->fourcc;
      f->fmt.pix.bytesperline = stride(c);
      f->fmt.pix.sizeimage = c->size;
      // No colour space that a header of today knows.
      f->fmt.pix.colorspace = 99;
      return 0;
    }
    case VIDIOC_S_PARM: {
      struct v4l2_streamparm *p = argument;
      p->parm.capture.timeperframe.numerator = 1;
      p->parm.capture.timeperframe.denominator = c->fps;
      return 0;
    }
    case VIDIOC_QUERYCTRL: {
      struct v4l2_queryctrl *q = argument;
      struct control *known = control(c, q->id);
      if (!known) return fail(EINVAL);
      q->minimum = known->minimum;
      q->maximum = known->maximum;
      q->step = 1;
      q->flags = 0;
      return 0;
    }
    case VIDIOC_G_CTRL:
    case VIDIOC_S_CTRL: {
      struct v4l2_control *v = argument;
      struct control *known = control(c, v->id);
      if (!known) return fail(EINVAL);
      if ((request & 0xffffffff) == VIDIOC_G_CTRL) {
        v->value = known->value;
        return 0;
      }
      if (v->value < known->minimum || v->value > known->maximum) return fail(ERANGE);
      // As UVC cameras do: no exposure by hand while the automatic sets it.
      if (v->id == V4L2_CID_EXPOSURE_ABSOLUTE && control(c, V4L2_CID_EXPOSURE_AUTO)->value != V4L2_EXPOSURE_MANUAL)
        return fail(EACCES);
      if (v->id == V4L2_CID_EXPOSURE_AUTO && v->value == 0) return fail(EINVAL);
      known->value = v->value;
      return 0;
    }
    case VIDIOC_REQBUFS: {
      struct v4l2_requestbuffers *r = argument;
      if (c->busy) return fail(EBUSY);
      if (r->count > BUFFERS) r->count = BUFFERS;
      c->buffers = r->count;
      c->queued = 0;
      return 0;
    }
    case VIDIOC_QUERYBUF:
    case VIDIOC_QBUF: {
      struct v4l2_buffer *b = argument;
      if ((int)b->index >= c->buffers) return fail(EINVAL);
      b->length = c->size;
      b->m.offset = b->index * c->size;
      if ((request & 0xffffffff) == VIDIOC_QUERYBUF) return 0;
      for (int i = 0; i < c->queued; i++) {
        if (c->queue[i] == (int)b->index) return fail(EINVAL);
      }
      c->queue[c->queued++] = b->index;
      return 0;
    }
    case VIDIOC_DQBUF:
      return take(c, argument);
    case VIDIOC_STREAMON:
      c->streaming = 1;
      c->frame = 0;
      c->next = now() + 1 / c->fps;
      return 0;
    case VIDIOC_STREAMOFF:
      c->streaming = 0;
      c->queued = 0;
      return gone(c) ? fail(ENODEV) : 0;
    default:
      return fail(ENOTTY);
  }
}

static struct camera *camera(int fd) { return fd >= 0 && fd < DESCRIPTORS && cameras[fd].used ? &cameras[fd] : NULL; }

static long controlled(int fd, unsigned long request, void *argument) {
  pthread_mutex_lock(&lock);
  long result = answer(camera(fd), request, argument);
  pthread_mutex_unlock(&lock);
  return result;
}

#define OPEN(name)                                                      \
  int name(const char *path, int flags, ...) {                          \
    va_list rest;                                                       \
    va_start(rest, flags);                                              \
    int mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, int) : 0;   \
    va_end(rest);                                                       \
    int fd = flags & O_CREAT ? -2 : open_camera(path);                                         \
    if (fd != -2) return fd;                                            \
    int (*real)(const char *, int, ...) = dlsym(RTLD_NEXT, #name);      \
    return real(path, flags, mode);                                     \
  }
OPEN(open)
OPEN(open64)

int close(int fd) {
  struct camera *c = camera(fd);
  if (c) {
    pthread_mutex_lock(&lock);
    munmap(c->memory, c->size * BUFFERS);
    c->used = 0;
    pthread_mutex_unlock(&lock);
  }
  int (*real)(int) = dlsym(RTLD_NEXT, "close");
  return real(fd);
}

int poll(struct pollfd *fds, nfds_t count, int timeout) {
  struct camera *c = count == 1 ? camera(fds[0].fd) : NULL;
  int (*real)(struct pollfd *, nfds_t, int) = dlsym(RTLD_NEXT, "poll");
  if (!c) return real(fds, count, timeout);
  double until = now() + timeout * 1e-3;
  for (;;) {
    pthread_mutex_lock(&lock);
    int unplugged = gone(c), ready = unplugged || due(c);
    pthread_mutex_unlock(&lock);
    fds[0].revents = unplugged ? POLLERR | POLLHUP : ready ? POLLIN : 0;
    if (ready || (timeout >= 0 && now() >= until)) return ready;
    usleep(500);
  }
}

int ioctl(int fd, unsigned long request, ...) {
  va_list rest;
  va_start(rest, request);
  void *argument = va_arg(rest, void *);
  va_end(rest);
  if (camera(fd)) return controlled(fd, request, argument);
  int (*real)(int, unsigned long, ...) = dlsym(RTLD_NEXT, "ioctl");
  return real(fd, request, argument);
}

// The `v4l` crate calls ioctl by its number.
long syscall(long number, ...) {
  va_list rest;
  va_start(rest, number);
  long a[6];
  for (int i = 0; i < 6; i++) a[i] = va_arg(rest, long);
  va_end(rest);
  if (number == SYS_ioctl && camera(a[0])) return controlled(a[0], a[1], (void *)a[2]);
  long (*real)(long, ...) = dlsym(RTLD_NEXT, "syscall");
  return real(number, a[0], a[1], a[2], a[3], a[4], a[5]);
}
