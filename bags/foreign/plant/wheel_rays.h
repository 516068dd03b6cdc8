// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// The wheels as SCM's terrain sees them.

#pragma once

#include <cmath>
#include <memory>
#include <vector>

#include "chrono/collision/ChCollisionSystem.h"
#include "chrono/physics/ChBody.h"

using chrono::ChBody;
using chrono::ChVector3d;

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
