// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// A rover that turns, of Project Chrono's rigid bodies on its SCM terrain. Writes means over 0.1 s.
//
//     scm_turning OUT.csv SCHEDULE [key=value ...]
//
// SCHEDULE has lines "t slope lean v yaw_rate": s, deg uphill along x of the world, deg uphill
// along its y, m/s and rad/s of the commanded twist; values between two lines are interpolated.
// wheels=4 is the rigid skid-steer of the preset four_wheel_rover, wheels=6 the rocker-bogie of the
// preset mars_rover with every wheel steered and two rockers hinged below the centre of mass.
// Frames as in REP-103. The ground is level and gravity leans, so angles are relative to gravity.

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "chrono/collision/ChCollisionSystem.h"
#include "chrono/functions/ChFunctionConst.h"
#include "chrono/physics/ChBody.h"
#include "chrono/physics/ChLinkMate.h"
#include "chrono/physics/ChLinkMotorRotationAngle.h"
#include "chrono/physics/ChLinkMotorRotationSpeed.h"
#include "chrono/physics/ChSystemNSC.h"
#include "chrono/solver/ChDirectSolverLS.h"
#include "chrono_vehicle/terrain/SCMTerrain.h"

using chrono::ChBody;
using chrono::ChFrame;
using chrono::ChFunctionConst;
using chrono::ChLinkMateGeneric;
using chrono::ChLinkMotorRotationAngle;
using chrono::ChLinkMotorRotationSpeed;
using chrono::ChQuaternion;
using chrono::ChVector3d;

constexpr double DEG = chrono::CH_DEG_TO_RAD;

// Answers SCM's vertical rays by the exact cylinders of the wheels, so that Bullet is not needed.
class WheelRays : public chrono::ChCollisionSystem {
  public:
    void add(std::shared_ptr<ChBody> body, std::shared_ptr<chrono::ChCollisionModel> model,
             double radius, double width) {
        m_wheels.push_back({body, model, radius, 0.5 * width});
    }

    Type GetType() const override { return Type::BULLET; }
    void Initialize() override { m_initialized = true; }
    void BindAll() override {}
    void BindItem(std::shared_ptr<chrono::ChPhysicsItem>) override {}
    void Clear() override {}
    void Add(std::shared_ptr<chrono::ChCollisionModel>) override {}
    void Remove(std::shared_ptr<chrono::ChCollisionModel>) override {}
    void Run() override {}
    chrono::ChAABB GetBoundingBox() const override { return chrono::ChAABB(); }
    double GetTimerCollisionBroad() const override { return 0; }
    double GetTimerCollisionNarrow() const override { return 0; }
    void ReportContacts(chrono::ChContactContainer*) override {}
    void ReportProximities(chrono::ChProximityContainer*) override {}

    bool RayHit(const ChVector3d& from, const ChVector3d& to, chrono::ChCollisionModel*,
                ChRayhitResult& result) const override {
        return RayHit(from, to, result);
    }

    bool RayHit(const ChVector3d& from, const ChVector3d& to,
                ChRayhitResult& result) const override {
        result.hit = false;
        double nearest = 1.0;
        const ChVector3d ray = to - from;
        for (const auto& wheel : m_wheels) {
            const ChVector3d start = from - wheel.body->GetPos(),
                             axis = wheel.body->GetRot().GetAxisY();
            if (std::hypot(start.x(), start.y()) > wheel.radius + 2 * wheel.half_width) continue;
            // the part of the ray across the axis meets a circle
            const ChVector3d p = start - axis * Vdot(start, axis), d = ray - axis * Vdot(ray, axis);
            const double a = Vdot(d, d), b = Vdot(p, d),
                         c = Vdot(p, p) - wheel.radius * wheel.radius;
            const double root = b * b - a * c;
            if (a < 1e-12 || root <= 0) continue;
            const double share = (-b - std::sqrt(root)) / a;
            if (share < 0 || share > nearest ||
                std::abs(Vdot(start + ray * share, axis)) > wheel.half_width)
                continue;
            nearest = share;
            result.hit = true;
            result.abs_hitPoint = from + ray * share;
            result.abs_hitNormal = (p + d * share) * (1 / wheel.radius);
            result.dist_factor = share;
            result.hitModel = wheel.model.get();
        }
        return result.hit;
    }

  private:
    struct Cylinder {
        std::shared_ptr<ChBody> body;
        std::shared_ptr<chrono::ChCollisionModel> model;
        double radius, half_width;
    };
    std::vector<Cylinder> m_wheels;
};

// t, slope, lean, v, yaw rate
using Row = std::array<double, 5>;

static std::vector<Row> read_schedule(const char* path) {
    std::ifstream file(path);
    std::vector<Row> rows;
    for (std::string line; std::getline(file, line);) {
        Row row{};
        std::istringstream in(line);
        bool whole = !line.empty() && line[0] != '#';
        for (double& value : row) whole = whole && in >> value;
        if (whole) rows.push_back(row);
    }
    return rows;
}

static Row at(const std::vector<Row>& rows, double t) {
    if (t <= rows.front()[0]) return rows.front();
    for (size_t i = 1; i < rows.size(); i++)
        if (t <= rows[i][0]) {
            const double share = (t - rows[i - 1][0]) / (rows[i][0] - rows[i - 1][0]);
            Row row{};
            for (size_t k = 0; k < row.size(); k++)
                row[k] = rows[i - 1][k] + share * (rows[i][k] - rows[i - 1][k]);
            return row;
        }
    return rows.back();
}

struct Preset {
    double mass, gravity, radius, width, wheel_inertia, track;
    std::vector<double> axle_x;
    double centre_height, pivot_x, pivot_height;  // a pivot_height of 0: no bogie
};

struct Wheel {
    std::string name;
    double x, y;
    std::shared_ptr<ChBody> body, carrier;  // the carrier does not turn with the wheel
    std::shared_ptr<ChLinkMotorRotationSpeed> motor;
    std::shared_ptr<ChFunctionConst> rate, angle;
};

int main(int argc, char** argv) {
    if (argc < 3) {
        std::fprintf(stderr, "scm_turning OUT.csv SCHEDULE [key=value ...]\n");
        return 2;
    }
    std::map<std::string, double> with = {
        {"wheels", 4},  {"c", 800},      {"phi_deg", 31},  {"k_phi", 1523400}, {"k_c", 900},
        {"n", 1.1},     {"K", 0.025},    {"elastic", 5e7}, {"damping", 1e4},   {"node", 0.0125},
        {"dt", 0.0025}, {"seconds", 60}, {"before", 5}};
    for (int i = 3; i < argc; i++) {
        const std::string word = argv[i];
        const auto equals = word.find('=');
        if (equals == std::string::npos || !with.count(word.substr(0, equals))) {
            std::fprintf(stderr, "unknown %s\n", argv[i]);
            return 2;
        }
        with[word.substr(0, equals)] = std::atof(word.c_str() + equals + 1);
    }
    const auto rows = read_schedule(argv[2]);
    if (rows.empty()) {
        std::fprintf(stderr, "%s: no line \"t slope lean v yaw_rate\"\n", argv[2]);
        return 2;
    }
    const bool steered = with["wheels"] == 6;
    const Preset preset =
        steered ? Preset{185, 3.72, 0.13, 0.16, 0.02, 1.0, {0.7, 0.0, -0.7}, 0.45, -0.35, 0.30}
                : Preset{50, 9.81, 0.165, 0.12, 0.04, 0.57, {0.255, -0.255}, 0.25, 0.0, 0.0};

    chrono::ChSystemNSC system;
    system.SetNumThreads(1, 1, 1);
    auto rays = std::make_shared<WheelRays>();
    system.SetCollisionSystem(rays);
    system.SetSolver(std::make_shared<chrono::ChSolverSparseLU>());
    system.SetTimestepperType(chrono::ChTimestepper::Type::EULER_IMPLICIT_LINEARIZED);
    auto add = [&](double mass, const ChVector3d& inertia, const ChVector3d& place) {
        auto body = std::make_shared<ChBody>();
        body->SetMass(mass);
        body->SetInertiaXX(inertia);
        body->SetPos(place);
        body->EnableCollision(false);
        system.AddBody(body);
        return body;
    };
    const ChQuaternion<> across =
        chrono::QuatFromAngleX(-chrono::CH_PI_2);  // a link's z is y of the world
    auto hinge = [&](std::shared_ptr<ChBody> one, std::shared_ptr<ChBody> other,
                     const ChVector3d& place) {
        auto joint = std::make_shared<ChLinkMateGeneric>(true, true, true, true, true, false);
        joint->Initialize(one, other, ChFrame<>(place, across));
        system.AddLink(joint);
    };

    // What is neither wheel, knuckle nor bogie has the mass and place that give the whole its own.
    const double r = preset.radius, wheel_mass = preset.wheel_inertia / (0.5 * r * r);
    const double knuckle_mass = steered ? 0.5 : 0.0, bogie_mass = steered ? 2.0 : 0.0;
    const size_t count = 2 * preset.axle_x.size();
    const double rest = preset.mass - count * (wheel_mass + knuckle_mass) - 2 * bogie_mass;
    const double rest_x = -2 * bogie_mass * preset.pivot_x / rest;
    const double rest_height =
        (preset.mass * preset.centre_height - count * (wheel_mass + knuckle_mass) * r -
         2 * bogie_mass * preset.pivot_height) /
        rest;
    const double length = preset.axle_x.front() - preset.axle_x.back();
    const ChVector3d inertia(rest * preset.track * preset.track / 12, rest * length * length / 12,
                             rest * (preset.track * preset.track + length * length) / 12);
    std::array<std::shared_ptr<ChBody>, 2> rocker,
        bogie;  // left, right; without a bogie both rockers are the body
    if (steered) {
        for (int side = 0; side < 2; side++) {
            const double y = side == 0 ? 0.5 * preset.track : -0.5 * preset.track;
            rocker[side] = add(0.5 * rest, inertia * 0.5, ChVector3d(rest_x, 0, rest_height));
            bogie[side] = add(bogie_mass, ChVector3d(0.02, 0.1, 0.1),
                              ChVector3d(preset.pivot_x, y, preset.pivot_height));
            hinge(bogie[side], rocker[side], ChVector3d(preset.pivot_x, y, preset.pivot_height));
        }
        hinge(rocker[0], rocker[1], ChVector3d(0, 0, preset.pivot_height));
    } else {
        rocker[0] = rocker[1] = add(rest, inertia, ChVector3d(rest_x, 0, rest_height));
    }

    chrono::vehicle::SCMTerrain terrain(&system, false);
    // The grid crosses the wheels askew, so that no row of nodes enters at once.
    terrain.SetReferenceFrame(
        chrono::ChCoordsys<>(chrono::VNULL, chrono::QuatFromAngleZ(31.7 * DEG)));
    terrain.SetSoilParameters(with["k_phi"], with["k_c"], with["n"], with["c"], with["phi_deg"],
                              with["K"], with["elastic"], with["damping"]);

    static const char* axles[] = {"front", "middle", "rear"};
    std::vector<Wheel> wheels;
    for (size_t axle = 0; axle < preset.axle_x.size(); axle++)
        for (int side = 0; side < 2; side++) {
            Wheel wheel;
            const size_t word = axle + 1 == preset.axle_x.size() ? 2 : axle;
            wheel.name = std::string(axles[word]) + (side == 0 ? "_left" : "_right");
            wheel.x = preset.axle_x[axle];
            wheel.y = side == 0 ? 0.5 * preset.track : -0.5 * preset.track;
            const ChVector3d place(wheel.x, wheel.y, r);
            wheel.carrier = steered && axle > 0 ? bogie[side] : rocker[side];
            wheel.rate = std::make_shared<ChFunctionConst>(0.0);
            wheel.angle = std::make_shared<ChFunctionConst>(0.0);
            if (steered) {
                auto knuckle = add(knuckle_mass, ChVector3d(0.01, 0.01, 0.01), place);
                auto steering = std::make_shared<ChLinkMotorRotationAngle>();
                steering->Initialize(knuckle, wheel.carrier, ChFrame<>(place));
                steering->SetAngleFunction(wheel.angle);
                system.AddLink(steering);
                wheel.carrier = knuckle;
            }
            wheel.body = add(wheel_mass, ChVector3d(0.6, 1, 0.6) * preset.wheel_inertia, place);
            auto model = std::make_shared<chrono::ChCollisionModel>();
            wheel.body->AddCollisionModel(model);
            rays->add(wheel.body, model, r, preset.width);
            wheel.motor = std::make_shared<ChLinkMotorRotationSpeed>();
            wheel.motor->Initialize(wheel.body, wheel.carrier, ChFrame<>(place, across));
            wheel.motor->SetSpeedFunction(wheel.rate);
            system.AddLink(wheel.motor);
            terrain.AddActiveDomain(wheel.carrier, place - wheel.carrier->GetPos(),
                                    ChVector3d(1.8 * r, preset.width + 0.02, 2.1 * r));
            wheels.push_back(wheel);
        }
    terrain.Initialize(2, 2, with["node"]);

    FILE* out = std::fopen(argv[1], "w");
    if (!out) {
        std::fprintf(stderr, "%s cannot be written\n", argv[1]);
        return 2;
    }
    std::fprintf(
        out,
        "time,velocity,lateral_velocity,yaw_rate,pitch,roll,acceleration,bogie_left,bogie_right");
    for (const auto& wheel : wheels)
        for (const char* what : {"slip", "rate", "steering", "sinkage", "sinkage_rut", "contact",
                                 "torque", "load", "drawbar", "moment", "side"})
            std::fprintf(out, ",%s_%s", wheel.name.c_str(), what);
    std::fprintf(out, ",x,y,yaw\n");

    const double dt = with["dt"], settle = 0.5, start = settle + with["before"],
                 end = start + with["seconds"];
    const int steps_a_row = static_cast<int>(std::lround(0.1 / dt));
    enum { V, VY, TURN, PITCH, ROLL, PULL, LEFT, RIGHT, SCALARS };
    enum { RATE, HUB, STEER, CONTACT, TORQUE, LOAD, DRAWBAR, MOMENT, SIDE, EACH };
    std::array<double, SCALARS> sum{};
    std::vector<std::array<double, EACH>> sums(count, std::array<double, EACH>{});
    ChVector3d velocity_before;
    for (long step = 1; system.GetChTime() < end - 1e-9; step++) {
        const double t = system.GetChTime();
        Row now = at(rows, t - start);
        // Before the first row it stands, then drives straight up to the first command.
        const double share = t < settle ? 0.0 : std::min(1.0, (t - settle) / 1.0);
        const double late = std::min(1.0, std::max(0.0, (t - start + 2) / 2));
        now[1] *= late, now[2] *= late, now[3] *= share, now[4] *= share * late;
        const double up = std::sin(now[1] * DEG), beside = std::sin(now[2] * DEG);
        const ChVector3d gravity =
            ChVector3d(-up, -beside, -std::sqrt(1 - up * up - beside * beside)) * preset.gravity;
        system.SetGravitationalAcceleration(gravity);
        for (auto& wheel : wheels) {
            double speed = now[3] - now[4] * wheel.y, angle = 0;
            if (steered) {
                const double left = now[4] * wheel.x;
                angle = std::atan2(left, speed);
                speed = std::hypot(speed, left);
                if (std::abs(angle) > chrono::CH_PI_2 + 1e-9)
                    angle -= std::copysign(chrono::CH_PI, angle), speed = -speed;
                if (std::abs(speed) < 1e-9) angle = wheel.angle->GetConstant();
            }
            // A steering drive follows within 0.3 s.
            const double kept = std::exp(-dt / 0.3);
            wheel.angle->SetConstant(
                steered ? kept * wheel.angle->GetConstant() + (1 - kept) * angle : 0.0);
            wheel.rate->SetConstant(speed / r);
        }
        system.DoStepDynamics(dt);

        const ChVector3d ahead = rocker[0]->GetRot().GetAxisX() + rocker[1]->GetRot().GetAxisX();
        const ChVector3d x_axis = ahead.GetNormalized(),
                         y_axis = (rocker[0]->GetRot().GetAxisY() + rocker[1]->GetRot().GetAxisY())
                                      .GetNormalized();
        const ChVector3d velocity = 0.5 * (rocker[0]->GetPosDt() + rocker[1]->GetPosDt());
        if (step == 1) velocity_before = velocity;
        const ChVector3d down = gravity * (1 / preset.gravity);
        sum[V] += Vdot(velocity, x_axis), sum[VY] += Vdot(velocity, y_axis);
        sum[TURN] += 0.5 * (rocker[0]->GetAngVelLocal().z() + rocker[1]->GetAngVelLocal().z());
        sum[PITCH] += std::asin(-Vdot(x_axis, down)), sum[ROLL] += std::asin(-Vdot(y_axis, down));
        sum[PULL] += -Vdot(gravity, x_axis);
        for (int side = 0; steered && side < 2; side++)
            sum[LEFT + side] +=
                std::asin(bogie[side]->GetRot().GetAxisX().z()) - std::asin(x_axis.z());
        for (size_t i = 0; i < count; i++) {
            auto& wheel = wheels[i];
            auto& found = sums[i];
            const double angle = wheel.angle->GetConstant();
            const ChVector3d heading = x_axis * std::cos(angle) + y_axis * std::sin(angle),
                             flat = ChVector3d(heading.x(), heading.y(), 0).GetNormalized();
            ChVector3d force, torque;
            found[RATE] += wheel.motor->GetMotorAngleDt();
            found[HUB] += Vdot(wheel.body->GetPosDt(), flat);
            found[STEER] += angle;
            found[CONTACT] += -std::asin(heading.z());
            found[TORQUE] += wheel.motor->GetMotorTorque();
            if (!terrain.GetContactForceBody(wheel.body, force, torque)) continue;
            const ChVector3d axle = wheel.body->GetRot().GetAxisY();
            found[LOAD] += force.z(), found[DRAWBAR] += Vdot(force, flat),
                found[SIDE] += flat.x() * force.y() - flat.y() * force.x();
            found[MOMENT] += Vdot(torque, axle);
        }
        if (step % steps_a_row) continue;
        const double time = system.GetChTime() - start, n = steps_a_row;
        if (time > 0.05) {
            const double specific =
                Vdot(velocity - velocity_before, x_axis) / (n * dt) + sum[PULL] / n;
            std::fprintf(out, "%.3f,%.7f,%.7f,%.7f,%.7f,%.7f,%.7f,%.7f,%.7f", time, sum[V] / n,
                         sum[VY] / n, sum[TURN] / n, sum[PITCH] / n, sum[ROLL] / n, specific,
                         sum[LEFT] / n, sum[RIGHT] / n);
            for (size_t i = 0; i < count; i++) {
                const auto& found = sums[i];
                const double rate = found[RATE] / n, hub = found[HUB] / n, angle = found[STEER] / n;
                const ChVector3d place = wheels[i].body->GetPos(),
                                 heading = x_axis * std::cos(angle) + y_axis * std::sin(angle);
                double ground = 0;  // mean height just ahead of the wheel, over its width
                for (int k = -2; k <= 2; k++)
                    ground +=
                        terrain.GetHeight(place + heading * (std::copysign(0.14 / 0.13 * r, hub)) +
                                          ChVector3d(-heading.y(), heading.x(), 0) *
                                              (0.2 * k * preset.width)) /
                        5;
                const double lowest = place.z() - r;
                std::fprintf(out, ",%.6f,%.6f,%.6f,%.7f,%.7f,%.7f,%.5f,%.4f,%.4f,%.5f,%.4f",
                             1 - hub / (r * rate), rate, angle, -lowest, ground - lowest,
                             found[CONTACT] / n, found[TORQUE] / n, found[LOAD] / n,
                             found[DRAWBAR] / n, found[MOMENT] / n, found[SIDE] / n);
            }
            std::fprintf(out, ",%.4f,%.4f,%.5f\n", rocker[0]->GetPos().x(), rocker[0]->GetPos().y(),
                         std::atan2(x_axis.y(), x_axis.x()));
        }
        velocity_before = velocity;
        sum.fill(0);
        for (auto& each : sums) each.fill(0);
        if (!std::isfinite(rocker[0]->GetPos().z()) || rocker[0]->GetPos().z() < 0.1) {
            std::fprintf(stderr, "fell at %g s\n", system.GetChTime());
            break;
        }
    }
    std::fclose(out);
    return 0;
}
