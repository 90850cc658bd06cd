#include "mocks/stage/modbus_stage_server.h"

#include <utility>

namespace etalon {

ModbusStageServer::ModbusStageServer(SimulatedStage& stage, const StageProfile& profile, int port)
    : controller_(std::make_unique<ModbusController>(stage, profile)),
      server_(std::make_unique<ModbusServer>(*controller_, port)) {}

ModbusStageServer::ModbusStageServer(SimulatedStage& stage, const StageProfile& profile,
                                     const SerialPair& line, int unit)
    : controller_(std::make_unique<ModbusController>(stage, profile, unit)),
      server_(std::make_unique<ModbusServer>(*controller_, line)) {}

int ModbusStageServer::port() const {
    return server_->port();
}

void ModbusStageServer::set_script(ModbusScript script) {
    controller_->set_script(std::move(script));
}

void ModbusStageServer::close_connections() {
    server_->close_connections();
}

std::vector<ModbusRequest> ModbusStageServer::writes() const {
    return controller_->writes();
}

}  // namespace etalon
