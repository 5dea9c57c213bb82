#include "apps/stages/progress.hpp"

#include <algorithm>
#include <chrono>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "tests/catch.hpp"

namespace orbid::progress_test {
namespace {

using tests::ContainsSubstring;

void run_two_stages(apps::Progress& progress) {
    progress.begin("simulate", 100.0, "sections");
    progress.advance(100.0);
    progress.end("4 segments");
    progress.begin("orbits");
    progress.say("period 3: none found");
    progress.log("only for the log");
    progress.end();
}

TEST_CASE("away from a terminal a stage is one line", "[apps]") {
    std::ostringstream sink;
    apps::Progress progress(false, sink, false);
    run_two_stages(progress);
    const std::string text = sink.str();
    CHECK(std::count(text.begin(), text.end(), '\n') == 3);
    CHECK_THAT(text, ContainsSubstring("sections/s") && ContainsSubstring("4 segments") &&
                         ContainsSubstring("period 3: none found"));
    CHECK_THAT(text, !ContainsSubstring("\r") && !ContainsSubstring("only for the log"));
}

TEST_CASE("on a terminal a bar shows fraction, rate and remaining time and goes away", "[apps]") {
    std::ostringstream sink;
    apps::Progress progress(false, sink, true);
    progress.begin("orbits", 200.0, "starts");
    std::this_thread::sleep_for(std::chrono::milliseconds(120));  // longer than the shortest time between two bars
    progress.at(50.0, "searching");
    progress.end();
    const std::string text = sink.str();
    CHECK_THAT(text, ContainsSubstring("[#####...............]  25 %") && ContainsSubstring("starts/s") &&
                         ContainsSubstring(" left") && ContainsSubstring("searching"));
    CHECK_THAT(text, ContainsSubstring("\r\033[Korbits"));  // the bar is wiped before the stage's line
}

TEST_CASE("away from a terminal no stage is silent for long, whoever computes", "[apps][progress]") {
    std::ostringstream sink;
    apps::Progress progress(false, sink, false, std::chrono::milliseconds(200));
    progress.begin("estimate");
    progress.note("step 3, objective 12.5", 7.0);
    std::this_thread::sleep_for(std::chrono::milliseconds(900));  // a computation that tells nothing
    progress.note("step 4, objective 12.25");
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
    progress.end("converged");
    const std::string text = sink.str();
    // Four intervals and two, and the end; fewer if threads have to wait for a processor.
    CHECK(std::count(text.begin(), text.end(), '\n') >= 3);
    CHECK(std::count(text.begin(), text.end(), '\n') <= 9);
    CHECK_THAT(text, ContainsSubstring("step 3, objective 12.5; 6.") && ContainsSubstring(" s left\n") &&
                         ContainsSubstring("step 4, objective 12.25; time left unknown\n"));
    CHECK_THAT(progress.log_text(), ContainsSubstring("step 4, objective 12.25"));
}

TEST_CASE("work between stages is told only if it takes long", "[apps][progress]") {
    std::ostringstream sink;
    apps::Progress progress(false, sink, false, std::chrono::milliseconds(100));
    progress.within("checksums");
    progress.within("compiling");
    progress.within({});
    CHECK(sink.str().empty());
    CHECK(progress.times().empty());
    progress.within("report");
    std::this_thread::sleep_for(std::chrono::milliseconds(400));
    CHECK_THAT(sink.str(), ContainsSubstring("report") && ContainsSubstring("time left unknown"));
    // Within a stage it is the stage's state, until something else is.
    progress.begin("estimate");
    progress.within("first solutions");
    std::this_thread::sleep_for(std::chrono::milliseconds(400));
    CHECK_THAT(sink.str(), ContainsSubstring("estimate") && ContainsSubstring("first solutions"));
    progress.end("done");
    REQUIRE(progress.times().size() == 1);
    CHECK(progress.times()[0].stage == "estimate");
}

TEST_CASE("quiet prints nothing but keeps log and times", "[apps]") {
    std::ostringstream sink;
    apps::Progress progress(true, sink, true);
    run_two_stages(progress);
    progress.reused("estimate", "result.json fits");
    CHECK(sink.str().empty());
    CHECK_THAT(progress.log_text(), ContainsSubstring("simulate: started") && ContainsSubstring("only for the log") &&
                                        ContainsSubstring("result.json fits"));
    const auto times = progress.times();
    REQUIRE(times.size() == 3);
    CHECK(times[0].stage == "simulate");
    CHECK(times[0].seconds >= 0.0);
    CHECK(times[2].reused);
}

TEST_CASE("a stage left open is ended as stopped", "[apps]") {
    std::ostringstream sink;
    {
        apps::Progress progress(false, sink, false);
        progress.begin("estimate");
    }
    CHECK_THAT(sink.str(), ContainsSubstring("stopped"));
}

TEST_CASE("many threads may report at once", "[apps]") {
    std::ostringstream sink;
    apps::Progress progress(false, sink, false);
    progress.begin("orbits", 4000.0, "starts");
    std::vector<std::thread> threads;
    for (int i = 0; i < 4; ++i) {
        threads.emplace_back([&progress] {
            for (int k = 0; k < 1000; ++k) {
                progress.advance(1.0);
                progress.log("x");
            }
        });
    }
    for (auto& thread : threads) {
        thread.join();
    }
    progress.end();
    const std::string log = progress.log_text();
    CHECK(std::count(log.begin(), log.end(), '\n') == 4002);
}

TEST_CASE("durations read as people say them", "[apps]") {
    CHECK(apps::duration_text(0.123) == "0.12 s");
    CHECK(apps::duration_text(3.44) == "3.4 s");
    CHECK(apps::duration_text(59.97) == "1 min 00 s");
    CHECK(apps::duration_text(125.0) == "2 min 05 s");
    CHECK(apps::duration_text(3725.0) == "1 h 02 min");
    CHECK(apps::duration_text(-1.0) == "?");
}

TEST_CASE("timing.json lists stages, threads and versions", "[apps]") {
    const auto json = nlohmann::json::parse(
        apps::timing_text({{"simulate", 1.5, false}, {"orbits", 0.0, true}}, 2, {{"orbid", "0.1.0"}}));
    CHECK(json["stages"][0]["stage"] == "simulate");
    CHECK(json["stages"][1]["reused"] == true);
    CHECK(json["seconds"] == 1.5);
    CHECK(json["threads"] == 2);
    CHECK(json["versions"]["orbid"] == "0.1.0");
}

}  // namespace
}  // namespace orbid::progress_test
