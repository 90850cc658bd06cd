#include "station/commands.h"

#include "station/calibrate/commands.h"
#include "station/compare/commands.h"
#include "station/devices/commands.h"
#include "station/render/commands.h"
#include "station/studies/commands.h"

namespace etalon {

void declare_commands(Command& program) {
    for (const auto declare :
         {declare_qualify,    declare_serve,        declare_plan,    declare_oc,
          declare_report,     declare_certify,      declare_history, declare_compare,
          declare_calibrate,  declare_characterise, declare_render,  declare_detect,
          declare_marker,     declare_devices,      declare_capture, declare_stage,
          declare_register,   declare_expect,       declare_study,   declare_camera,
          declare_bench,      declare_stability,    declare_demo,    declare_init,
          declare_completion, declare_schema})
        declare(program);
}

}  // namespace etalon
