#include "tests/fakes/in_process_camera.h"

#include <arv.h>

namespace etalon {

InProcessCamera::InProcessCamera() {
    arv_enable_interface("Fake");
}

InProcessCamera::~InProcessCamera() {
    arv_disable_interface("Fake");
}

}  // namespace etalon
