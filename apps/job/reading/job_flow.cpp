#include "apps/job/flow_stepper.hpp"
#include "apps/job/job_parts.hpp"

namespace orbid::apps {

void read_flow(ObjectReader& root, Job& job) {
    const auto value = root.find("flow");
    if (!value) return;
    ObjectReader flow(*value);
    if (const auto stepper = flow.find("stepper")) {
        const auto choice = stepper->choice(flow_stepper_names);
        if (choice) job.stepper = static_cast<FlowStepper>(*choice);
        if (job.stepper == FlowStepper::odeint && job.model.system) {
            const std::string why = odeint_refusal(job);
            if (why.empty())
                job.model.system = with_stepper(job.model.system, job.stepper);
            else
                stepper->report(fmt::format("must be \"verner\" here: {}", why));
        }
    }
    flow.finish();
}

}  // namespace orbid::apps
